#include <fmt/format.h>

#include <Eigen/Geometry>
#include <array>
#include <bit>
#include <boost/algorithm/string/predicate.hpp>
#include <boost/endian/conversion.hpp>
#include <boost/functional/hash.hpp>
#include <cmath>
#include <cstdint>
#include <locale>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/text.h"
#include "common/mesh/joined.h"
#include "common/mesh/triangle_mesh.h"

namespace twoport {
namespace {

constexpr double kMostCoordinate = 1e6;
constexpr std::size_t kMostCorners = 1000;  // of a face

/// Collects triangles; the messages of both formats.
class Builder {
 public:
  explicit Builder(const std::string& name) : name_{name} {}

  [[noreturn]] void fail(const std::string& words) const { throw ConfigError{fmt::format("{}: {}", name_, words)}; }
  void check(const Eigen::Vector3d& v, const std::string& where) const {
    for (int i = 0; i < 3; ++i)
      if (!(std::abs(v[i]) <= kMostCoordinate))
        fail(fmt::format("{} has a coordinate {:.9g}; it must be a number of at most {:g}", where, v[i],
                         kMostCoordinate));
  }
  void vertex(const Eigen::Vector3d& v) { mesh_.vertices.push_back(v); }
  /// The index of a vertex there: an earlier one if there is one.
  std::uint32_t shared_vertex(const Eigen::Vector3d& v) {
    const auto [at, is_new] =
        index_.try_emplace({v.x() + 0.0, v.y() + 0.0, v.z() + 0.0}, static_cast<std::uint32_t>(mesh_.vertices.size()));
    if (is_new) vertex(v);
    return at->second;
  }
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const Eigen::Vector3d &p = mesh_.vertices[a], &q = mesh_.vertices[b], &r = mesh_.vertices[c];
    if (mesh_.triangles.size() + flat_.size() == kMostTriangles)
      fail(fmt::format("it has more than {} triangles", kMostTriangles));
    if ((q - p).cross(r - p).squaredNorm() > 0.0)
      mesh_.triangles.push_back({a, b, c});
    else if (p != q && q != r && r != p)
      flat_.push_back({a, b, c});
    else
      ++points_or_lines_;
  }
  /// Vertices that follow have places of their own.
  void new_solid() { index_.clear(); }
  /// Triangles of a plane polygon, convex or not, by its ears: those from its first corner where it is convex (Meisters, Polygons have
  /// ears, American Mathematical Monthly 82, 1975).
  void polygon(std::vector<std::uint32_t> corner) {
    const auto at = [&](std::size_t i) -> const Eigen::Vector3d& { return mesh_.vertices[corner[i % corner.size()]]; };
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    for (std::size_t i = 1; i + 1 < corner.size(); ++i) normal += (at(i) - at(0)).cross(at(i + 1) - at(0));
    const auto turn = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
      return normal.dot((b - a).cross(c - a));
    };
    const auto is_ear = [&](std::size_t i) {
      const Eigen::Vector3d &a = at(i - 1), &b = at(i), &c = at(i + 1);
      if (!(turn(a, b, c) > 0.0)) return false;
      for (std::size_t k = 0; k < corner.size(); ++k) {
        const Eigen::Vector3d& p = at(k);
        if (p == a || p == b || p == c) continue;
        if (turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0) return false;
      }
      return true;
    };
    while (corner.size() > 3) {
      std::size_t ear = 1;
      while (ear <= corner.size() && !is_ear(ear)) ++ear;
      if (ear > corner.size()) ear = 1;  // of no simple polygon: the shell is refused later
      const std::size_t i = ear % corner.size();
      triangle(corner[(i + corner.size() - 1) % corner.size()], corner[i], corner[(i + 1) % corner.size()]);
      corner.erase(corner.begin() + static_cast<std::ptrdiff_t>(i));
    }
    triangle(corner[0], corner[1], corner[2]);
  }
  [[nodiscard]] std::size_t vertices() const { return mesh_.vertices.size(); }
  TriangleMesh finish(std::string& left_out) {
    if (mesh_.triangles.empty()) fail("it has no triangle with an area");
    std::size_t flat = 0;
    TriangleMesh mesh = joined(std::move(mesh_), flat_, flat);
    flat += points_or_lines_;
    if (flat > 0)
      left_out = fmt::format("{}: {} without area {} left out", name_,
                             flat == 1 ? "1 triangle" : fmt::format("{} triangles", flat), flat == 1 ? "is" : "are");
    return mesh;
  }

 private:
  using Place = std::array<double, 3>;
  const std::string& name_;
  TriangleMesh mesh_;
  std::vector<TriangleMesh::Triangle> flat_;  ///< with three places and no area
  std::size_t points_or_lines_ = 0;           ///< with fewer places
  std::unordered_map<Place, std::uint32_t, boost::hash<Place>> index_;
};

// --- text ----------------------------------------------------------------------------------------

/// Takes words and lines off a text.
class Words {
 public:
  explicit Words(std::string_view text) : text_{text} {}

  [[nodiscard]] std::size_t line() const { return line_; }
  /// The next word of this line; empty at its end.
  std::string_view next() {
    for (std::size_t n = 1; n > 0; text_.remove_prefix(n)) {
      n = text_.starts_with("\\\n") ? 2 : text_.starts_with("\\\r\n") ? 3 : 0;  // the line goes on
      if (n > 0)
        ++line_;
      else
        n = !text_.empty() && is_blank(text_.front());
    }
    std::size_t n = 0;
    while (n < text_.size() && !is_blank(text_[n]) && text_[n] != '\n') ++n;
    const std::string_view word = text_.substr(0, n);
    text_.remove_prefix(n);
    return word;
  }
  /// To the next line. False at the end of the text.
  bool next_line() {
    const std::size_t n = text_.find('\n');
    if (n == std::string_view::npos) {
      text_ = {};
      return false;
    }
    text_.remove_prefix(n + 1);
    ++line_;
    return !text_.empty();
  }
  /// The next word, on this line or a later one; empty at the end of the text.
  std::string_view next_anywhere() {
    for (;;) {
      if (const std::string_view word = next(); !word.empty()) return word;
      if (!next_line()) return {};
    }
  }

 private:
  static bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }
  std::string_view text_;
  std::size_t line_ = 1;
};

/// A word for a message: printable, and not long.
std::string in_quotes(std::string_view word) {
  std::string out;
  for (const char c : word.substr(0, 20)) out += c >= ' ' && c <= '~' ? c : '?';
  return "\"" + out + "\"";
}

template <class Number>
std::optional<Number> number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  return number_from<Number>(word);
}

template <class Next>
Eigen::Vector3d coordinates(const Builder& builder, const Words& words, Next next) {
  Eigen::Vector3d v;
  for (int i = 0; i < 3; ++i) {
    const std::string_view word = next();
    const std::optional<double> value = number<double>(word);
    if (!value)
      builder.fail(fmt::format("line {}: {} stands where a coordinate is expected", words.line(), in_quotes(word)));
    v[i] = *value;
  }
  builder.check(v, fmt::format("line {}", words.line()));
  return v;
}

bool is_word(std::string_view word, std::string_view wanted) {
  return boost::algorithm::iequals(word, wanted, std::locale::classic());
}

void parse_ascii_stl(std::string_view content, Builder& builder) {
  Words words{content};
  const auto fail = [&](std::string_view word, std::string_view wanted) {
    builder.fail(fmt::format("line {}: {} stands where {} is expected", words.line(), in_quotes(word), wanted));
  };
  const auto expect = [&](std::string_view wanted) {
    if (const std::string_view word = words.next_anywhere(); !is_word(word, wanted))
      fail(word, fmt::format("\"{}\"", wanted));
  };
  for (std::string_view solid = words.next_anywhere(); !solid.empty(); solid = words.next_anywhere()) {
    if (!is_word(solid, "solid")) fail(solid, "\"solid\" or the end of the file");
    words.next_line();  // its name
    builder.new_solid();
    for (;;) {
      const std::string_view word = words.next_anywhere();
      if (is_word(word, "endsolid")) break;
      if (!is_word(word, "facet")) fail(word, "\"facet\" or \"endsolid\"");
      expect("normal");
      for (int i = 0; i < 3; ++i) words.next_anywhere();  // what it says does not count: the order of the vertices does
      expect("outer"), expect("loop");
      std::uint32_t corner[3];
      for (std::uint32_t& each : corner) {
        expect("vertex");
        each = builder.shared_vertex(coordinates(builder, words, [&] { return words.next_anywhere(); }));
      }
      expect("endloop"), expect("endfacet");
      builder.triangle(corner[0], corner[1], corner[2]);
    }
    words.next_line();  // its name
  }
}

/// The vertex that I, I/J, I//K or I/J/K names, from 1; negative ones count backwards from the newest.
std::uint32_t obj_index(const Builder& builder, const Words& words, std::string_view word) {
  const std::optional<std::int64_t> index = number<std::int64_t>(word.substr(0, word.find('/')));
  const auto count = static_cast<std::int64_t>(builder.vertices());
  if (!index || *index == 0 || *index > count || *index < -count)
    builder.fail(fmt::format("line {}: {} names no vertex; there are {} so far", words.line(), in_quotes(word), count));
  return static_cast<std::uint32_t>(*index > 0 ? *index - 1 : count + *index);
}

void parse_obj(std::string_view content, Builder& builder) {
  Words words{content};
  do {
    const std::string_view kind = words.next();
    if (kind == "v") {
      builder.vertex(coordinates(builder, words, [&] { return words.next(); }));
    } else if (kind == "f") {
      std::vector<std::uint32_t> corners;
      for (std::string_view word = words.next(); !word.empty(); word = words.next()) {
        if (corners.size() == kMostCorners)
          builder.fail(fmt::format("line {}: a face has more than {} vertices", words.line(), kMostCorners));
        corners.push_back(obj_index(builder, words, word));
      }
      if (corners.size() < 3) builder.fail(fmt::format("line {}: a face has fewer than three vertices", words.line()));
      builder.polygon(std::move(corners));
    }
  } while (words.next_line());
}

// --- binary --------------------------------------------------------------------------------------

constexpr std::size_t kHeader = 84, kFacet = 50;  // [bytes]

std::uint32_t little_endian(std::string_view bytes) {
  return boost::endian::load_little_u32(reinterpret_cast<const unsigned char*>(bytes.data()));
}

void parse_binary_stl(std::string_view content, Builder& builder) {
  const std::size_t count = (content.size() - kHeader) / kFacet;
  for (std::size_t i = 0; i < count; ++i) {
    const std::string_view facet = content.substr(kHeader + i * kFacet, kFacet);
    std::uint32_t corner[3];
    for (std::size_t k = 0; k < 3; ++k) {
      Eigen::Vector3d v;
      for (std::size_t axis = 0; axis < 3; ++axis)
        v[static_cast<int>(axis)] =
            static_cast<double>(std::bit_cast<float>(little_endian(facet.substr(12 * (k + 1) + 4 * axis, 4))));
      builder.check(v, fmt::format("triangle {}", i));
      corner[k] = builder.shared_vertex(v);
    }
    builder.triangle(corner[0], corner[1], corner[2]);
  }
}

void parse(std::string_view content, Builder& builder) {
  if (content.size() >= kHeader) {
    const std::uint64_t count = little_endian(content.substr(80, 4));
    if (content.size() == kHeader + count * kFacet) return parse_binary_stl(content, builder);
  }
  if (const std::string_view encoding = wide_encoding(content); !encoding.empty())
    builder.fail(fmt::format("it is in {}; save it as UTF-8", encoding));
  const bool is_text = content.find('\0') == content.npos;
  Words words{content};
  const std::string_view first = words.next_anywhere();
  if (is_text && is_word(first, "solid")) return parse_ascii_stl(content, builder);
  // An OBJ file is text of which each line that counts begins with a keyword; one of them is v.
  Words lines{content};
  do {
    if (is_text && lines.next() == "v") return parse_obj(content, builder);
  } while (lines.next_line());
  const std::string neither =
      "it is no triangle mesh that is read here: neither STL (a binary one is 84 + 50 n bytes long) nor Wavefront OBJ";
  if (first == "ply" || first.starts_with("glTF") || first.starts_with("<?xml") || first.starts_with("<COLLADA"))
    builder.fail(neither + "; MeshLab and Blender export both");
  if (!is_text && content.size() >= kHeader && is_word(first.substr(0, 5), "solid"))
    builder.fail(fmt::format("it is {} bytes long, and a binary STL of {} triangles, as its header says, is {}",
                             content.size(), little_endian(content.substr(80, 4)),
                             kHeader + std::uint64_t{little_endian(content.substr(80, 4))} * kFacet));
  builder.fail(neither);
}

}  // namespace

TriangleMesh parse_mesh(std::string_view content, const std::string& name, std::string& left_out) {
  Builder builder{name};
  parse(content, builder);
  return builder.finish(left_out);
}
TriangleMesh parse_mesh(std::string_view content, const std::string& name) {
  std::string left_out;
  return parse_mesh(content, name, left_out);
}

}  // namespace twoport
