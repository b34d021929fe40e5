#include "common/scene/load.h"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/io/tokenizer.h>
#include <google/protobuf/message.h>
#include <google/protobuf/text_format.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <limits>
#include <memory>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <utility>

#include "common/base/check.h"
#include "common/scene/summary.h"
#include "proto/scene.pb.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;

// The plain enums count as the schema does, so that a value crosses by its number.
template <class Plain, class Schema>
constexpr bool same(Plain plain, Schema schema) {
  return static_cast<int>(plain) == static_cast<int>(schema);
}
static_assert(same(Architecture::render, schema::Control::RENDER) &&
              same(Architecture::position_force, schema::Control::POSITION_FORCE) &&
              same(Architecture::position_measured_force, schema::Control::POSITION_MEASURED_FORCE) &&
              same(Architecture::position_position, schema::Control::POSITION_POSITION) &&
              same(Architecture::uncontrolled, schema::Control::UNCONTROLLED) &&
              same(Architecture::uncontrolled, schema::Control::Architecture_MAX));
static_assert(same(Integrator::exact, schema::Simulation::EXACT) &&
              same(Integrator::exact_per_tick, schema::Simulation::EXACT_PER_TICK) &&
              same(Integrator::symplectic_euler, schema::Simulation::SYMPLECTIC_EULER) &&
              same(Integrator::trapezoidal, schema::Simulation::TRAPEZOIDAL) &&
              same(Integrator::velocity_verlet, schema::Simulation::VELOCITY_VERLET) &&
              same(Integrator::rk4, schema::Simulation::RK4) &&
              same(Integrator::rk4, schema::Simulation::Integrator_MAX));
static_assert(same(Method::none, schema::Passivity::NONE) && same(Method::classic, schema::Passivity::CLASSIC) &&
              same(Method::force_projected, schema::Passivity::FORCE_PROJECTED) &&
              same(Method::force_projected, schema::Passivity::Method_MAX));
static_assert(same(ObserverRule::exact, schema::Passivity::EXACT) &&
              same(ObserverRule::rectangle, schema::Passivity::RECTANGLE) &&
              same(ObserverRule::rectangle, schema::Passivity::Observer_MAX));
static_assert(same(Accounts::total, schema::Passivity::TOTAL) &&
              same(Accounts::normal_tangential, schema::Passivity::NORMAL_TANGENTIAL) &&
              same(Accounts::per_contact, schema::Passivity::PER_CONTACT) &&
              same(Accounts::translation_rotation, schema::Passivity::TRANSLATION_ROTATION) &&
              same(Accounts::translation_rotation, schema::Passivity::Accounts_MAX));
static_assert(same(VelocityEstimate::true_velocity, schema::Device::TRUE_VELOCITY) &&
              same(VelocityEstimate::backward_difference, schema::Device::BACKWARD_DIFFERENCE) &&
              same(VelocityEstimate::filtered, schema::Device::FILTERED) &&
              same(VelocityEstimate::filtered, schema::Device::VelocityEstimate_MAX));
static_assert(same(JitterDistribution::normal, schema::Impairment::NORMAL) &&
              same(JitterDistribution::uniform, schema::Impairment::UNIFORM) &&
              same(JitterDistribution::pareto, schema::Impairment::PARETO) &&
              same(JitterDistribution::pareto, schema::Impairment::Jitter_MAX));

// ---- files

/// The whole file; `name` is what a complaint calls it.
std::string read_file(const std::filesystem::path& path, const std::string& name) {
  errno = 0;
  std::ifstream in{path, std::ios::binary};
  std::string text;
  char chunk[4096];
  while (in && (in.read(chunk, sizeof chunk), in.gcount() > 0))
    text.append(chunk, static_cast<std::size_t>(in.gcount()));
  if (!in.is_open() || in.bad())
    throw ConfigError{fmt::format("{}: cannot be read: {}", name, std::generic_category().message(errno))};
  return text;
}

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kBlank);
  return first == text.npos ? std::string_view{} : text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

// ---- text to message

/// A complaint of the text-format parser in our words.
struct Complaint {
  std::string words;
  std::string about;  ///< the token it is about, which the parser has just passed; empty: it stands at it
};

std::string field_names(const pb::Descriptor& block) {
  std::vector<std::string> names;
  for (int i = 0; i < block.field_count(); ++i) names.push_back(block.field(i)->name());
  return fmt::format("{}", fmt::join(names, ", "));
}

std::string value_names(const pb::EnumDescriptor& choice) {
  std::vector<std::string> names;
  for (int i = 0; i < choice.value_count(); ++i) names.push_back(choice.value(i)->name());
  return fmt::format("{}", fmt::join(names, ", "));
}

/// The enum behind the field `name`, looked for in every block of the schema; null if there is none.
const pb::EnumDescriptor* enum_of(const std::string& name) {
  const pb::FileDescriptor& schema = *schema::Scene::descriptor()->file();
  for (int i = 0; i < schema.message_type_count(); ++i)
    if (const pb::FieldDescriptor* field = schema.message_type(i)->FindFieldByName(name); field && field->enum_type())
      return field->enum_type();
  return nullptr;
}

Complaint reworded(const std::string& message) {
  std::vector<std::string> quoted;
  for (std::size_t open = message.find('"'); open != message.npos;) {
    const std::size_t close = message.find('"', open + 1);
    if (close == message.npos) break;
    quoted.push_back(message.substr(open + 1, close - open - 1));
    open = message.find('"', close + 1);
  }
  const auto starts = [&](std::string_view words, std::size_t quotes) {
    return message.starts_with(words) && quoted.size() == quotes;
  };
  if (starts("Message type ", 2)) {
    const pb::Descriptor* block = schema::Scene::descriptor()->file()->pool()->FindMessageTypeByName(quoted[0]);
    if (block)
      return {fmt::format("{} has no field \"{}\"; it has {}", block->name(), quoted[1], field_names(*block)),
              quoted[1]};
  }
  if (starts("Unknown enumeration value of ", 2))
    if (const pb::EnumDescriptor* choice = enum_of(quoted[1]))
      return {fmt::format("{} is {}; it must be one of {}", quoted[1], quoted[0], value_names(*choice)), quoted[0]};
  if (starts("Invalid value for boolean field ", 2))
    return {fmt::format("{} is {}; it must be true or false", quoted[0], quoted[1]), quoted[1]};
  if (starts("Non-repeated field ", 1)) return {fmt::format("{} is given twice", quoted[0]), quoted[0]};
  if (starts("Field ", 3))
    return {fmt::format("{} is given beside {}; only one of the two can be", quoted[0], quoted[1]), quoted[0]};
  if (message.ends_with("got: ")) return {message + "the end of the text", ""};
  return {message, ""};
}

/// The parser's first complaint, and where.
class FirstComplaint : public pb::io::ErrorCollector {
 public:
  void AddError(int line, pb::io::ColumnNumber column, const std::string& message) override {
    if (made_) return;
    made_ = true;
    line_ = std::max(line, 0);
    column_ = std::max(column, 0);
    complaint_ = reworded(message);
  }
  [[nodiscard]] const std::string& words() const { return complaint_.words; }

  /// "LINE:COLUMN" in `text`, from 1, of the token that the complaint is about. Columns count bytes.
  [[nodiscard]] std::string place(const std::string& text) const {
    std::size_t offset = 0;
    for (int skipped = 0; skipped < line_; ++skipped) {
      const std::size_t end = text.find('\n', offset);
      if (end == text.npos) break;
      offset = end + 1;
    }
    // The parser counts a tab up to the next multiple of 8.
    for (int column = 0; column < column_ && offset < text.size() && text[offset] != '\n'; ++offset)
      column = text[offset] == '\t' ? (column / 8 + 1) * 8 : column + 1;
    if (!complaint_.about.empty() && offset > 0)
      if (const std::size_t passed = text.rfind(complaint_.about, offset - 1); passed != text.npos) offset = passed;
    const auto begin = text.begin(), here = begin + static_cast<std::ptrdiff_t>(offset);
    const std::size_t newline = offset == 0 ? text.npos : text.rfind('\n', offset - 1);
    return fmt::format("{}:{}", std::count(begin, here, '\n') + 1,
                       newline == text.npos ? offset + 1 : offset - newline);
  }

 private:
  bool made_ = false;
  int line_ = 0, column_ = 0;
  Complaint complaint_;
};

void parse_text(const std::string& text, const std::string& file, schema::Scene& scene) {
  FirstComplaint complaint;
  pb::TextFormat::Parser parser;
  parser.RecordErrorsTo(&complaint);
  if (!parser.ParseFromString(text, &scene))
    throw ConfigError{fmt::format("{}:{}: {}", file, complaint.place(text), complaint.words())};
}

// ---- overrides

/// What a field may hold, in words.
std::string allowed(const pb::FieldDescriptor& field, bool element) {
  std::string one;
  switch (field.cpp_type()) {
    case pb::FieldDescriptor::CPPTYPE_DOUBLE:
      one = "a number";
      break;
    case pb::FieldDescriptor::CPPTYPE_INT32:
      one = "an integer";
      break;
    case pb::FieldDescriptor::CPPTYPE_UINT64:
      one = "an integer >= 0";
      break;
    case pb::FieldDescriptor::CPPTYPE_BOOL:
      one = "true or false";
      break;
    case pb::FieldDescriptor::CPPTYPE_STRING:
      one = "a string";
      break;
    case pb::FieldDescriptor::CPPTYPE_ENUM:
      one = "one of " + value_names(*field.enum_type());
      break;
    case pb::FieldDescriptor::CPPTYPE_MESSAGE:
      one = fmt::format("a block {{ ... }} of {}", field_names(*field.message_type()));
      break;
    default:
      one = field.cpp_type_name();
      break;
  }
  return field.is_repeated() && !element ? fmt::format("a list [...], each {}", one) : one;
}

/// Sets what "PATH=VALUE" names. VALUE is read by the text-format parser, as a field of an otherwise empty block.
void apply_override(pb::Message& scene, const std::string& assignment) {
  const auto wrong = [&](const std::string& words) {
    return ConfigError{fmt::format("override {}: {}", assignment, words)};
  };
  const std::size_t equals = assignment.find('=');
  if (equals == assignment.npos) throw wrong("it must read PATH=VALUE");
  std::string_view rest = trimmed(std::string_view{assignment}.substr(0, equals));
  std::string value{trimmed(std::string_view{assignment}.substr(equals + 1))};

  pb::Message* block = &scene;
  std::string above = "a scene";  // what holds the field, as a complaint calls it
  for (std::string so_far;;) {
    // One step of the path: a name and perhaps an index.
    const std::size_t dot = rest.find('.');
    const std::string_view step = rest.substr(0, dot);
    const bool last = dot == rest.npos;
    const std::size_t bracket = step.find('[');
    const std::string name{step.substr(0, bracket)};
    const pb::Descriptor& descriptor = *block->GetDescriptor();
    const pb::Reflection& reflection = *block->GetReflection();
    const pb::FieldDescriptor* field = descriptor.FindFieldByName(name);
    if (!field) throw wrong(fmt::format("no field \"{}\" in {}; it has {}", name, above, field_names(descriptor)));
    so_far += so_far.empty() ? name : "." + name;

    const bool indexed = bracket != step.npos;
    int index = -1;
    if (indexed) {
      if (!field->is_repeated()) throw wrong(fmt::format("{} is not a list, it takes no index", so_far));
      const char* end = step.data() + step.size();
      const auto [stop, error] = std::from_chars(step.data() + bracket + 1, end, index);
      if (error != std::errc{} || stop + 1 != end || *stop != ']' || index < 0)
        throw wrong(fmt::format("{} must be followed by an index such as [0]", so_far));
      const int size = reflection.FieldSize(*block, field);
      if (index > size)
        throw wrong(
            fmt::format("{} holds {} now: the index must be 0 to {}, the last of which appends", so_far, size, size));
      so_far += fmt::format("[{}]", index);
    }

    if (last) {
      if (field->cpp_type() == pb::FieldDescriptor::CPPTYPE_STRING && !value.starts_with('"') &&
          !value.starts_with('\''))
        value = fmt::format("\"{}\"", value);  // a shell takes the quotes off
      const std::unique_ptr<pb::Message> alone{block->New()};
      FirstComplaint complaint;
      pb::TextFormat::Parser parser;
      parser.RecordErrorsTo(&complaint);
      const bool parsed = parser.ParseFromString(fmt::format("{}: {}", name, value), alone.get());
      if (!parsed && field->message_type())
        throw wrong(fmt::format("it must be {} ({})", allowed(*field, indexed), complaint.words()));
      std::vector<const pb::FieldDescriptor*> set;
      reflection.ListFields(*alone, &set);
      const bool only = set.empty() ? field->is_repeated() && !indexed : set.size() == 1 && set[0] == field;
      if (!parsed || !only || (indexed && reflection.FieldSize(*alone, field) != 1))
        throw wrong(fmt::format("it must be {}", allowed(*field, indexed)));

      if (!indexed) {
        reflection.ClearField(block, field);
        block->MergeFrom(*alone);
        return;
      }
      const int size = reflection.FieldSize(*block, field);
      block->MergeFrom(*alone);  // appends
      if (index < size) {
        reflection.SwapElements(block, field, index, size);
        reflection.RemoveLast(block, field);
      }
      return;
    }

    if (!field->message_type())
      throw wrong(fmt::format("{} is {}, nothing lies below it", so_far, allowed(*field, indexed)));
    if (field->is_repeated() && !indexed) throw wrong(fmt::format("{} is a list, say which: {}[0]", so_far, so_far));
    if (!indexed)
      block = reflection.MutableMessage(block, field);
    else if (index < reflection.FieldSize(*block, field))
      block = reflection.MutableRepeatedMessage(block, field, index);
    else
      block = reflection.AddMessage(block, field);
    above = so_far;
    rest = rest.substr(dot + 1);
  }
}

// ---- message to values

/// What a number must be, and how a complaint says it.
struct Rule {
  bool (*holds)(double);
  const char* words;
};
constexpr Rule kFinite{[](double v) { return std::isfinite(v); }, "be a finite number"};
// Beyond this sums of squares leave what a double holds.
constexpr Rule kPositive{[](double v) { return v > 0.0 && v <= 1e18; }, "be > 0 and at most 1e18"};
constexpr Rule kNotNegative{[](double v) { return v >= 0.0 && v <= 1e18; }, "be >= 0 and at most 1e18"};
constexpr Rule kProbability{[](double v) { return v >= 0.0 && v <= 1.0; }, "be between 0 and 1"};
constexpr Rule kRate{[](double v) { return v > 0.0 && v <= 1e5; }, "be > 0 and at most 100000"};
constexpr Rule kSpan{[](double v) { return v > 0.0 && v <= 1e6; }, "be > 0 and at most 1000000"};
constexpr Rule kDelay{[](double v) { return v >= 0.0 && v <= 1e6; }, "be between 0 and 1000000"};

/// How long a list may be: `few` numbers, or `many` with what `more` says.
struct Count {
  int few, many;
  const char* more;
  [[nodiscard]] std::string words() const {
    const std::string alone = fmt::format("hold {} number{}", few, few == 1 ? "" : "s");
    return few == many ? alone : fmt::format("{}, or {} {}", alone, many, more);
  }
};

/// What every check of one scene needs to know.
struct Context {
  std::string file;
  int dof = 0;

  [[nodiscard]] Count point() const {
    const int axes = dof == 1 ? 1 : 3;
    return {axes, axes, ""};
  }
  [[nodiscard]] Count pose() const { return dof == 6 ? Count{3, 7, "with the attitude w x y z"} : point(); }
  [[nodiscard]] Count twist() const { return dof == 6 ? Count{3, 6, "with the rotation"} : point(); }
};

/// One block of the scene and where it stands. Whatever is taken out of it is checked on the way, and every complaint
/// names file, path, value and what is allowed. The context and the message must outlive it.
class Block {
 public:
  Block(const Context& context, const pb::Message& message, std::string path = "")
      : context_{context}, message_{message}, path_{std::move(path)} {}

  [[nodiscard]] int dof() const { return context_.dof; }
  [[nodiscard]] const Context& context() const { return context_; }

  [[nodiscard]] bool has(const char* name) const {
    const pb::FieldDescriptor& f = field(name);
    return f.is_repeated() ? reflection().FieldSize(message_, &f) > 0 : reflection().HasField(message_, &f);
  }
  /// A number, the schema's default where it is absent.
  [[nodiscard]] double number(const char* name, const Rule& rule) const {
    const double value = reflection().GetDouble(message_, &field(name));
    for (const Rule& each : {kFinite, rule})
      if (!each.holds(value)) refuse(name, each.words);
    return value;
  }
  [[nodiscard]] double required(const char* name, const Rule& rule) const {
    require(name, rule.words);
    return number(name, rule);
  }
  [[nodiscard]] double number_or(const char* name, const Rule& rule, double absent) const {
    return has(name) ? number(name, rule) : absent;
  }
  [[nodiscard]] int integer(const char* name) const { return reflection().GetInt32(message_, &field(name)); }
  [[nodiscard]] bool flag(const char* name) const { return reflection().GetBool(message_, &field(name)); }
  [[nodiscard]] std::string text(const char* name) const { return reflection().GetString(message_, &field(name)); }
  template <class Enum>
  [[nodiscard]] Enum choice(const char* name) const {
    return static_cast<Enum>(reflection().GetEnumValue(message_, &field(name)));
  }
  /// A list of finite numbers; empty where it is absent.
  [[nodiscard]] Numbers list(const char* name, const Count& count) const {
    const pb::FieldDescriptor& f = field(name);
    Numbers values;
    for (int i = 0; i < reflection().FieldSize(message_, &f); ++i)
      values.push_back(reflection().GetRepeatedDouble(message_, &f, i));
    const auto length = static_cast<int>(values.size());
    if (length != 0 && length != count.few && length != count.many) refuse(name, count.words());
    if (!std::all_of(values.begin(), values.end(), kFinite.holds)) refuse(name, "hold finite numbers");
    return values;
  }
  [[nodiscard]] Block block(const char* name) const {
    return {context_, reflection().GetMessage(message_, &field(name)), path_of(name)};
  }
  [[nodiscard]] std::vector<Block> blocks(const char* name) const {
    const pb::FieldDescriptor& f = field(name);
    std::vector<Block> all;
    for (int i = 0; i < reflection().FieldSize(message_, &f); ++i)
      all.emplace_back(context_, reflection().GetRepeatedMessage(message_, &f, i),
                       fmt::format("{}[{}]", path_of(name), i));
    return all;
  }

  void require(const char* name, const std::string& words) const {
    if (!has(name)) fail(fmt::format("{} is missing; it must {}", path_of(name), words));
  }
  /// Refuses what turns, where nothing does.
  void only_with_rotation(std::initializer_list<const char*> names) const {
    for (const char* name : names)
      if (dof() != 6 && has(name))
        fail(fmt::format("{} is given, but applies to dof 6 only; dof is {}", path_of(name), dof()));
  }
  [[noreturn]] void refuse(const char* name, const std::string& words) const {
    fail(fmt::format("{} is {}; it must {}", path_of(name), value_of(field(name)), words));
  }
  /// The same of the block itself: it holds nothing.
  [[noreturn]] void refuse_empty() const {
    fail(fmt::format("{} is empty; it must hold one of {}", path_, field_names(*message_.GetDescriptor())));
  }
  [[noreturn]] void fail(const std::string& words) const {
    throw ConfigError{fmt::format("{}: {}", context_.file, words)};
  }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::string path_of(const char* name) const { return path_.empty() ? name : path_ + "." + name; }

 private:
  [[nodiscard]] const pb::Reflection& reflection() const { return *message_.GetReflection(); }
  [[nodiscard]] const pb::FieldDescriptor& field(const char* name) const {
    return *message_.GetDescriptor()->FindFieldByName(name);
  }
  [[nodiscard]] std::string value_of(const pb::FieldDescriptor& f) const {
    std::vector<std::string> values(f.is_repeated() ? static_cast<std::size_t>(reflection().FieldSize(message_, &f))
                                                    : 1);
    for (std::size_t i = 0; i < values.size(); ++i)
      pb::TextFormat::PrintFieldValueToString(message_, &f, f.is_repeated() ? static_cast<int>(i) : -1, &values[i]);
    return f.is_repeated() ? fmt::format("[{}]", fmt::join(values, ", ")) : values[0];
  }

  const Context& context_;
  const pb::Message& message_;
  std::string path_;
};

double length_of(const Numbers& values) {
  double squares = 0.0;
  for (double v : values) squares += v * v;
  return std::sqrt(squares);
}

/// A direction, made of unit length.
Numbers direction(const Block& of, const char* name) {
  of.require(name, of.context().point().words());
  Numbers values = of.list(name, of.context().point());
  const double longest = std::abs(
      *std::max_element(values.begin(), values.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }));
  if (longest == 0.0) of.refuse(name, "not be zero: it is a direction");
  for (double& v : values) v /= longest;  // its square may be beyond what a double holds
  const double length = length_of(values);
  for (double& v : values) v /= length;
  return values;
}

/// A position; with an attitude, that one made of unit length.
Numbers pose(const Block& of, const char* name) {
  Numbers values = of.list(name, of.context().pose());
  if (values.size() == 7) {
    const double length = length_of({values.begin() + 3, values.end()});
    if (!(std::abs(length - 1.0) <= 1e-3))
      of.refuse(name, fmt::format("end in a unit quaternion w x y z, whose length is 1 and not {:.9g}", length));
    for (std::size_t i = 3; i < 7; ++i) values[i] /= length;
  }
  return values;
}

HandSpec hand(const Block& of) {
  of.only_with_rotation({"inertia_kg_m2", "rotational_stiffness_n_m_per_rad", "rotational_damping_n_m_s_per_rad"});
  return {.mass_kg = of.number("mass_kg", kNotNegative),
          .stiffness_n_per_m = of.number("stiffness_n_per_m", kNotNegative),
          .damping_n_s_per_m = of.number("damping_n_s_per_m", kNotNegative),
          .inertia_kg_m2 = of.number("inertia_kg_m2", kNotNegative),
          .rotational_stiffness_n_m_per_rad = of.number("rotational_stiffness_n_m_per_rad", kNotNegative),
          .rotational_damping_n_m_s_per_rad = of.number("rotational_damping_n_m_s_per_rad", kNotNegative)};
}

SegmentSpec segment(const Block& of) {
  if (of.has("hold")) return HoldSpec{of.block("hold").required("duration_s", kSpan)};
  if (of.has("move_to")) {
    const Block move = of.block("move_to");
    return MoveToSpec{.position_m = pose(move, "position_m"), .duration_s = move.required("duration_s", kSpan)};
  }
  if (of.has("screw")) {
    const Block screw = of.block("screw");
    if (of.dof() == 1) of.fail(fmt::format("{} is given, but dof is 1; a screw needs dof 3 or 6", of.path_of("screw")));
    return ScrewSpec{.point_m = screw.list("point_m", of.context().point()),
                     .axis = direction(screw, "axis"),
                     .angle_rad = screw.number("angle_rad", kFinite),
                     .travel_m = screw.number("travel_m", kFinite),
                     .frequency_hz = screw.required("frequency_hz", kPositive),
                     .duration_s = screw.required("duration_s", kSpan)};
  }
  if (!of.has("sine")) of.refuse_empty();
  const Block sine = of.block("sine");
  const int axis = sine.integer("axis");
  if (axis < 0 || axis >= of.dof()) sine.refuse("axis", fmt::format("be 0 to {}", of.dof() - 1));
  return SineSpec{.axis = axis,
                  .amplitude_m = sine.required("amplitude_m", kFinite),
                  .frequency_hz = sine.required("frequency_hz", kPositive),
                  .duration_s = sine.required("duration_s", kSpan)};
}

TremorSpec tremor(const Block& of) {
  const TremorSpec spec{.rms_m = of.required("rms_m", kNotNegative),
                        .low_hz = of.number("low_hz", kNotNegative),
                        .high_hz = of.number("high_hz", kRate)};
  if (!(spec.low_hz < spec.high_hz))
    of.refuse("low_hz", fmt::format("be < {} ({})", of.path_of("high_hz"), spec.high_hz));
  return spec;
}

OperatorSpec human(const Block& of) {
  OperatorSpec spec;
  if (of.has("hand")) spec.hand = hand(of.block("hand"));
  for (const Block& each : of.blocks("path")) spec.path.push_back(segment(each));
  if (of.has("tremor")) spec.tremor = tremor(of.block("tremor"));
  return spec;
}

DeviceSpec device(const Block& of) {
  of.only_with_rotation({"inertia_kg_m2", "rotational_damping_n_m_s_per_rad"});
  DeviceSpec spec{.mass_kg = of.number("mass_kg", kNotNegative),
                  .damping_n_s_per_m = of.number("damping_n_s_per_m", kNotNegative),
                  .position_m = pose(of, "position_m"),
                  .velocity_m_per_s = of.list("velocity_m_per_s", of.context().twist()),
                  .coulomb_friction_n = of.number("coulomb_friction_n", kNotNegative),
                  .position_resolution_m = of.number("position_resolution_m", kNotNegative),
                  .max_force_n = std::nullopt,
                  .velocity_estimate = of.choice<VelocityEstimate>("velocity_estimate"),
                  .velocity_filter_hz = of.number("velocity_filter_hz", kPositive),
                  .inertia_kg_m2 = of.number("inertia_kg_m2", kNotNegative),
                  .rotational_damping_n_m_s_per_rad = of.number("rotational_damping_n_m_s_per_rad", kNotNegative)};
  if (of.has("max_force_n")) spec.max_force_n = of.number("max_force_n", kPositive);
  return spec;
}

CouplingOptions coupling(const Block& of) {
  of.only_with_rotation({"rotational_stiffness_n_m_per_rad", "rotational_damping_n_m_s_per_rad"});
  return {.stiffness_n_per_m = of.number("stiffness_n_per_m", kNotNegative),
          .damping_n_s_per_m = of.number("damping_n_s_per_m", kNotNegative),
          .rotational_stiffness_n_m_per_rad = of.number("rotational_stiffness_n_m_per_rad", kNotNegative),
          .rotational_damping_n_m_s_per_rad = of.number("rotational_damping_n_m_s_per_rad", kNotNegative),
          .catch_up_m_per_s = of.number("catch_up_m_per_s", kNotNegative),
          .drift_compensation = of.flag("drift_compensation")};
}

RegistrationOptions registration(const Block& of) {
  RegistrationOptions options;
  options.absolute = of.choice<schema::Registration::Mode>("mode") == schema::Registration::ABSOLUTE;
  if (of.has("rotation")) {
    if (of.dof() == 1)
      of.fail(fmt::format("{} is given, but dof is 1; a rotation needs dof 3 or 6", of.path_of("rotation")));
    const Numbers q = of.list("rotation", Count{4, 4, ""});
    options.rotation = Eigen::Quaterniond{q[0], q[1], q[2], q[3]};
    if (std::abs(options.rotation.norm() - 1.0) > 1e-3) of.refuse("rotation", "be of length 1");
    options.rotation.normalize();
  }
  if (of.has("position_m")) {
    if (!options.absolute)
      of.fail(fmt::format("{} is given, but {} is OFFSET; it needs ABSOLUTE", of.path_of("position_m"),
                          of.path_of("mode")));
    options.position_m = vector<3>(of.list("position_m", of.context().point()));
  }
  return options;
}

ControlOptions control(const Block& of) {
  const Block passivity = of.block("passivity");
  ControlOptions options;
  options.architecture = of.choice<Architecture>("architecture");
  options.coupling = coupling(of.block("virtual_coupling"));
  options.force_scale = of.number("force_scale", kPositive);
  options.motion_scale = of.number("motion_scale", kPositive);
  options.registration = registration(of.block("registration"));
  options.method_name =
      schema::Passivity::Method_Name(static_cast<schema::Passivity::Method>(passivity.choice<Method>("method")));
  options.controller = {.method = passivity.choice<Method>("method"),
                        .max_gain = passivity.number("max_gain", kNotNegative),
                        .unilateral = passivity.flag("unilateral"),
                        .predict = passivity.flag("predict")};
  options.observer = passivity.choice<ObserverRule>("observer");
  options.accounts = passivity.choice<Accounts>("accounts");
  options.reference_energy = passivity.flag("reference_energy");
  const bool rendering = options.architecture == Architecture::render;
  options.initial_energy = Energy{passivity.number_or("initial_energy_j", kNotNegative, rendering ? 0.0 : 1e-3)};
  options.engage = Seconds{of.number("engage_s", kDelay)};
  options.hold_after = Seconds{of.number("hold_after_s", kSpan)};
  options.release_after = Seconds{of.number("release_after_s", kSpan)};
  if (!(options.hold_after < options.release_after))
    of.refuse("hold_after_s", fmt::format("be < {} ({})", of.path_of("release_after_s"), options.release_after.si()));

  // Only a rendering knows its contacts and their potential.
  if (!rendering && options.accounts != Accounts::total)
    passivity.refuse("accounts", "be TOTAL over a link: only control.architecture RENDER knows its contacts");
  if (of.dof() != 6 && options.accounts == Accounts::translation_rotation)
    passivity.refuse("accounts", fmt::format("be another one: nothing turns with dof {}", of.dof()));
  return options;
}

/// One delay in ms per line; blank lines and what follows a # are skipped.
std::vector<double> recorded_delays(const Block& of) {
  const std::string trace = of.text("trace_file");
  const std::filesystem::path path = std::filesystem::path{of.context().file}.parent_path() / trace;
  const std::string file = path.string();
  const std::string text =
      read_file(path, fmt::format("{}: {}: {}", of.context().file, of.path_of("trace_file"), file));
  std::vector<double> delays;
  int line = 0;
  for (std::string_view rest = text; !rest.empty();) {
    ++line;
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    const std::string_view whole = rest.substr(0, end);
    const std::string_view entry = trimmed(whole.substr(0, whole.find('#')));
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (entry.empty()) continue;
    double ms = 0.0;
    const auto [stop, error] = std::from_chars(entry.data(), entry.data() + entry.size(), ms);
    if (error != std::errc{} || stop != entry.data() + entry.size() || !kDelay.holds(ms))
      of.fail(fmt::format("{}: {}:{}: \"{}\" is not a delay in ms; it must {}", of.path_of("trace_file"), file, line,
                          entry, kDelay.words));
    delays.push_back(ms * 1e-3);
  }
  if (delays.empty())
    of.fail(fmt::format("{}: {} holds no delay; it must hold one a line", of.path_of("trace_file"), file));
  return delays;
}

ImpairmentOptions impairment(const Block& of) {
  ImpairmentOptions options;
  options.delay_s = of.number("delay_ms", kDelay) * 1e-3;
  options.jitter_s = of.number("jitter_ms", kDelay) * 1e-3;
  options.jitter_distribution = of.choice<JitterDistribution>("jitter_distribution");
  options.loss = of.number("loss", kProbability);
  if (of.has("burst")) {
    const Block burst = of.block("burst");
    options.burst = GilbertElliottOptions{.p = burst.required("p", kProbability),
                                          .r = burst.required("r", kProbability),
                                          .loss_good = burst.number("loss_good", kProbability),
                                          .loss_bad = burst.number("loss_bad", kProbability)};
  }
  for (const Block& window : of.blocks("blackout"))
    options.blackout.push_back(
        {.start_s = window.required("start_s", kNotNegative), .duration_s = window.required("duration_s", kPositive)});
  options.duplicate = of.number("duplicate", kProbability);
  options.reorder = of.number("reorder", kProbability);
  options.reorder_s = of.number("reorder_ms", kDelay) * 1e-3;
  if (of.has("trace_file")) options.recorded_delay_s = recorded_delays(of);
  return options;
}

/// Three principal moments; one number stands for all three.
Numbers robot_inertia(const Block& of) {
  of.only_with_rotation({"inertia_kg_m2"});
  if (of.dof() != 6) return {};
  const Count count{1, 3, "for the principal moments"};
  of.require("inertia_kg_m2", count.words());
  Numbers moments = of.list("inertia_kg_m2", count);
  moments.resize(3, moments[0]);
  const auto [least, most] = std::minmax_element(moments.begin(), moments.end());
  if (!(*least > 0.0)) of.refuse("inertia_kg_m2", "hold numbers > 0");
  const double others = moments[0] + moments[1] + moments[2] - *most;
  if (*most > others * (1.0 + 1e-12))
    of.refuse("inertia_kg_m2", "keep the triangle inequality: no principal moment exceeds the sum of the other two");
  return moments;
}

RobotSpec robot(const Block& of) {
  of.only_with_rotation({"rotational_damping_n_m_s_per_rad"});
  RobotSpec spec{.mass_kg = of.required("mass_kg", kPositive),
                 .damping_n_s_per_m = of.number("damping_n_s_per_m", kNotNegative),
                 .position_m = pose(of, "position_m"),
                 .velocity_m_per_s = of.list("velocity_m_per_s", of.context().twist()),
                 .force_sensor = std::nullopt,
                 .inertia_kg_m2 = robot_inertia(of),
                 .rotational_damping_n_m_s_per_rad = of.number("rotational_damping_n_m_s_per_rad", kNotNegative)};
  if (of.has("force_sensor")) {
    const Block sensor = of.block("force_sensor");
    spec.force_sensor = ForceSensorSpec{.noise_n = sensor.number("noise_n", kNotNegative),
                                        .bias_n = sensor.list("bias_n", of.context().twist()),
                                        .latency_s = sensor.number("latency_ms", kDelay) * 1e-3};
  }
  return spec;
}

Material material(const Block& of) {
  return {.stiffness_n_per_m = of.required("stiffness_n_per_m", kPositive),
          .damping_n_s_per_m = of.number("damping_n_s_per_m", kNotNegative),
          .friction = of.number("friction", kNotNegative),
          .viscous_friction_n_s_per_m = of.number("viscous_friction_n_s_per_m", kNotNegative)};
}

Wall read(const Block& of, std::type_identity<Wall>) {
  return {.normal = vector<3>(direction(of, "normal")), .offset_m = of.number("offset_m", kFinite)};
}
Sphere read(const Block& of, std::type_identity<Sphere>) {
  return {.center_m = vector<3>(of.list("center_m", of.context().point())),
          .radius_m = of.required("radius_m", kPositive)};
}
Cylinder read(const Block& of, std::type_identity<Cylinder>) {
  if (of.dof() == 1) of.fail(fmt::format("{} is given, but dof is 1; a cylinder needs dof 3 or 6", of.path()));
  return {.point_m = vector<3>(of.list("point_m", of.context().point())),
          .axis = vector<3>(direction(of, "axis")),
          .radius_m = of.required("radius_m", kPositive)};
}
Box read(const Block& of, std::type_identity<Box>) {
  const Count point = of.context().point();
  of.require("half_size_m", point.words());
  const Numbers half_size = of.list("half_size_m", point);
  if (!std::all_of(half_size.begin(), half_size.end(), kPositive.holds)) of.refuse("half_size_m", "hold numbers > 0");
  return {.center_m = vector<3>(of.list("center_m", point)), .half_size_m = vector<3>(half_size)};
}

EnvironmentSpec environment(const Block& of) {
  std::optional<EnvironmentSpec> found;
  for_each_shape([&]<class S>(std::type_identity<S> shape) {
    if (!of.has(S::kName)) return;
    const Block block = of.block(S::kName);
    found = Surface{read(block, shape), material(block)};
  });
  if (found) return *found;
  if (!of.has(Spring::kName)) of.refuse_empty();
  const Block spring = of.block(Spring::kName);
  return Spring{.stiffness_n_per_m = spring.required("stiffness_n_per_m", kNotNegative),
                .damping_n_s_per_m = spring.number("damping_n_s_per_m", kNotNegative),
                .anchor_m = vector<3>(spring.list("anchor_m", of.context().point()))};
}

std::vector<Eigen::Vector3d> tool(const Block& scene) {
  scene.only_with_rotation({"tool"});
  std::vector<Eigen::Vector3d> points;
  for (const Block& point : scene.block("tool").blocks("contact_point"))
    points.push_back(vector<3>(point.list("position_m", {3, 3, ""})));
  if (points.empty() && scene.dof() == 6) points.push_back(Eigen::Vector3d::Zero());
  return points;
}

/// A name that a bound may have: `stable` has its own field.
void check_key(const Block& bound) {
  const std::string key = bound.text("key");
  if (key == "stable") bound.refuse("key", "be a number of the summary; `expect { stable: ... }` is for that one");
  std::vector<std::string> known;
  for (const auto& [name, value] : numbers(Summary{}))
    if (name != "stable") known.push_back(name);
  if (std::find(known.begin(), known.end(), key) == known.end())
    bound.refuse("key", fmt::format("be one of {}", fmt::join(known, ", ")));
}

ExpectSpec expect(const Block& of) {
  ExpectSpec spec;
  if (of.has("stable")) spec.stable = of.flag("stable");
  const auto bounds = [&](const char* name) {
    std::vector<Bound> all;
    for (const Block& bound : of.blocks(name)) {
      check_key(bound);
      all.push_back({bound.text("key"), bound.required("value", kFinite)});
    }
    return all;
  };
  spec.at_least = bounds("at_least");
  spec.at_most = bounds("at_most");
  return spec;
}

/// Integrators that are maps of a linear motion need one: a mass on springs and at most one plane wall.
void check_simulation(const Block& of, const Scene& values) {
  const Integrator i = values.simulation.integrator;
  if (i != Integrator::exact_per_tick && i != Integrator::trapezoidal) return;
  int walls = 0;
  bool linear = values.dof != 6;
  for (const EnvironmentSpec& e : values.environment)
    if (const auto* surface = std::get_if<Surface>(&e)) {
      ++walls;
      linear = linear && std::holds_alternative<Wall>(surface->shape) && surface->material.friction == 0.0;
    }
  if (!linear || walls > 1)
    of.refuse("integrator", "be another one here: it needs dof 1 or 3, springs and at most one wall without friction");
}

SimulationSpec simulation(const Block& of) {
  const int substeps = of.integer("substeps");
  if (substeps < 1 || substeps > 10'000) of.refuse("substeps", "be 1 to 10000");
  return {of.choice<Integrator>("integrator"), substeps};
}

/// An account each for what is normal and tangential to a contact.
void check_accounts(const Block& scene, const Scene& values) {
  constexpr std::size_t kMost = 16;
  const std::size_t contacts = values.environment.size() * std::max<std::size_t>(values.tool.size(), 1);
  if (values.control.accounts == Accounts::per_contact && contacts > kMost)
    scene.fail(
        fmt::format("control.passivity.accounts is PER_CONTACT with {} contacts; it must be <= {}: environments "
                    "times contact points of the tool",
                    contacts, kMost));
}

/// A body alone needs one.
void check_uncontrolled(const Block& scene, const Scene& values) {
  if (values.control.architecture != Architecture::uncontrolled) return;
  if (!values.robot) scene.fail("robot is missing; with control.architecture UNCONTROLLED it is all that moves");
  for (const char* name : {"operator", "device", "to_slave", "to_master"})
    if (scene.has(name))
      scene.fail(fmt::format("{} is given, but control.architecture is UNCONTROLLED: only the robot moves", name));
}

/// Without a link there is neither a far side nor a way to it.
void check_rendering(const Block& scene, const Scene& values) {
  if (values.control.architecture != Architecture::render) return;
  for (const char* name : {"robot", "to_slave", "to_master"})
    if (scene.has(name))
      scene.fail(
          fmt::format("{} is given, but control.architecture is RENDER: without a link nothing would use it", name));
}

/// A handle that is not led along a path moves by its own dynamics, and needs something to move.
void check_handle(const Block& scene, const Scene& values) {
  const bool held = values.human && values.human->hand;
  const bool free = values.device && !values.human;
  if (!held && !free) return;
  const auto sum = [&](double DeviceSpec::*of_device, double HandSpec::*of_hand) {
    return (values.device ? *values.device.*of_device : 0.0) + (held ? *values.human->hand.*of_hand : 0.0);
  };
  const auto need = [&](const char* name, double total) {
    if (total > 0.0) return;
    const std::string of_hand = held ? fmt::format(" + operator.hand.{}", name) : "";
    scene.fail(
        fmt::format("device.{}{} is {}; it must be > 0: the handle moves by its own dynamics", name, of_hand, total));
  };
  need("mass_kg", sum(&DeviceSpec::mass_kg, &HandSpec::mass_kg));
  if (values.dof == 6) need("inertia_kg_m2", sum(&DeviceSpec::inertia_kg_m2, &HandSpec::inertia_kg_m2));
}

/// What moves by itself must not turn, or come to rest, too many times within a tick: the plants are exact however stiff
/// they are, and take the longer for it.
void check_fastest(const Block& scene, const Scene& values) {
  constexpr double kMost = 1e4;  // [rad] in a tick
  const auto check = [&](const char* what, double rate_hz, double mass, double damping, double stiffness) {
    const double turns = std::max(damping / mass, std::sqrt(stiffness / mass)) / rate_hz;
    if (mass > 0.0 && !(turns <= kMost))
      scene.fail(
          fmt::format("{} {:.3g} on stiffness {:.3g} and damping {:.3g} moves by {:.3g} rad in a tick; "
                      "it must be <= {:g}: what is so stiff is better left out",
                      what, mass, stiffness, damping, turns, kMost));
  };
  const HandSpec hand = values.human && values.human->hand ? *values.human->hand : HandSpec{};
  const DeviceSpec device = values.device.value_or(DeviceSpec{});
  check("device and operator.hand: mass", values.master_rate_hz, hand.mass_kg + device.mass_kg,
        hand.damping_n_s_per_m + device.damping_n_s_per_m, hand.stiffness_n_per_m);
  if (values.dof == 6)
    check("device and operator.hand: inertia", values.master_rate_hz, hand.inertia_kg_m2 + device.inertia_kg_m2,
          hand.rotational_damping_n_m_s_per_rad + device.rotational_damping_n_m_s_per_rad,
          hand.rotational_stiffness_n_m_per_rad);
  if (!values.robot) return;
  double stiffness = 0.0, damping = values.robot->damping_n_s_per_m;
  const World world{values.environment};
  for (const Surface& each : world.surfaces) {
    stiffness += each.material.stiffness_n_per_m;
    damping += each.material.damping_n_s_per_m;
  }
  for (const Spring& each : world.springs) {
    stiffness += each.stiffness_n_per_m;
    damping += each.damping_n_s_per_m;
  }
  check("robot and environment: mass", values.slave_rate_hz, values.robot->mass_kg, damping, stiffness);
}

Scene validated(const schema::Scene& message, const std::string& file) {
  Context context{.file = file, .dof = message.dof()};
  const Block of{context, message};
  of.require("dof", "be 1, 3 or 6");
  if (context.dof != 1 && context.dof != 3 && context.dof != 6) of.refuse("dof", "be 1, 3 or 6");

  Scene scene{};
  scene.name = of.has("name") ? of.text("name") : std::filesystem::path{file}.stem().string();
  scene.description = of.text("description");
  scene.dof = context.dof;
  scene.duration_s = of.required("duration_s", kSpan);
  scene.rate_hz = of.number("rate_hz", kRate);
  scene.master_rate_hz = of.number_or("master_rate_hz", kRate, scene.rate_hz);
  scene.slave_rate_hz = of.number_or("slave_rate_hz", kRate, scene.rate_hz);
  constexpr double kMostTicks = std::numeric_limits<std::uint32_t>::max();  // as a summary counts them
  const double ticks = scene.duration_s * std::max(scene.master_rate_hz, scene.slave_rate_hz);
  if (ticks > kMostTicks)
    of.refuse("duration_s", fmt::format("last at most {:.0f} ticks, and makes {:.9g}", kMostTicks, ticks));
  scene.seed = message.seed();
  if (of.has("operator")) scene.human = human(of.block("operator"));
  if (of.has("device")) scene.device = device(of.block("device"));
  scene.control = control(of.block("control"));
  tell_handle(scene);
  scene.to_slave = impairment(of.block("to_slave"));
  scene.to_master = impairment(of.block("to_master"));
  if (of.has("robot")) scene.robot = robot(of.block("robot"));
  for (const Block& each : of.blocks("environment")) scene.environment.push_back(environment(each));
  scene.tool = tool(of);
  scene.expect = expect(of.block("expect"));
  scene.simulation = simulation(of.block("simulation"));
  check_simulation(of.block("simulation"), scene);
  check_rendering(of, scene);
  check_uncontrolled(of, scene);
  check_handle(of, scene);
  check_fastest(of, scene);
  check_accounts(of, scene);
  return scene;
}

/// FNV-1a, 64 bits, over bytes in an order of our own, so that it is the same on every machine.
class Digest {
 public:
  void add(std::uint64_t bits) {
    for (int byte = 0; byte < 8; ++byte) value_ = (value_ ^ ((bits >> (8 * byte)) & 0xff)) * 0x100000001b3;
  }
  void add(double number) { add(std::bit_cast<std::uint64_t>(number + 0.0)); }  // -0 and 0 are one number
  void add(int number) { add(static_cast<std::uint64_t>(number)); }
  void add(bool flag) { add(static_cast<std::uint64_t>(flag)); }
  void add(Seconds t) { add(t.si()); }
  void add(Energy e) { add(e.si()); }
  template <class Enum>
  requires std::is_enum_v<Enum>
  void add(Enum choice) { add(static_cast<std::uint64_t>(choice)); }
  template <class... Values>
  void all(const Values&... values) {
    (add(values), ...);
  }
  [[nodiscard]] std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325;
};

}  // namespace

void tell_handle(Scene& scene) {
  const HandSpec hand = scene.human && scene.human->hand ? *scene.human->hand : HandSpec{};
  const DeviceSpec device = scene.device.value_or(DeviceSpec{});
  scene.control.handle_mass_kg = device.mass_kg > 0.0 ? device.mass_kg : hand.mass_kg;
  scene.control.handle_inertia_kg_m2 = device.inertia_kg_m2 > 0.0 ? device.inertia_kg_m2 : hand.inertia_kg_m2;
  if (device.max_force_n) scene.control.max_force_n = *device.max_force_n;
}

Scene parse_scene(const std::string& text, const std::string& name, std::span<const std::string> overrides) {
  schema::Scene message;
  parse_text(text, name, message);
  for (const std::string& assignment : overrides) apply_override(message, assignment);
  return validated(message, name);
}

Scene load_scene(const std::string& path, std::span<const std::string> overrides) {
  return parse_scene(read_file(path, path), path, overrides);
}

std::uint64_t scene_digest(const Scene& scene) {
  // Taken apart by name: a new option does not compile until it is decided here whether it counts. What the handle
  // weighs and what the device can display is the master's own; the name of the method is its number's.
  const auto& [architecture, coupling, force_scale, motion_scale, registration, method_name, controller, observer,
               accounts, reference_energy, initial_energy, handle_mass, handle_inertia, max_force, engage, hold_after,
               release_after] = scene.control;
  const auto& [stiffness, damping, rotational_stiffness, rotational_damping, catch_up, drift_compensation] = coupling;
  const auto& [method, max_gain, unilateral, predict] = controller;
  Digest digest;
  digest.all(scene.dof, scene.master_rate_hz, scene.slave_rate_hz);
  digest.all(architecture, force_scale, motion_scale, observer, accounts, reference_energy, initial_energy);
  digest.all(engage, hold_after, release_after);
  digest.all(registration.absolute);
  for (const double each :
       {registration.rotation.w(), registration.rotation.x(), registration.rotation.y(), registration.rotation.z(),
        registration.position_m.x(), registration.position_m.y(), registration.position_m.z()})
    digest.all(each);
  digest.all(stiffness, damping, rotational_stiffness, rotational_damping, catch_up, drift_compensation);
  digest.all(method, max_gain, unilateral, predict);
  return digest.value();
}

}  // namespace twoport
