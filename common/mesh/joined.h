#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "common/mesh/triangle_mesh.h"

namespace twoport {

/// parse_mesh(content, name) that says in one sentence, with `name`, what the file has and the mesh has not; empty: nothing.
TriangleMesh parse_mesh(std::string_view content, const std::string& name, std::string& left_out);

/// A mesh whose edges are joined where they meet; one that has none to join is returned as it is, to the bit. Files give faces, or parts of
/// a surface, vertices of their own. Of the edges that are not of two triangles in opposite directions two are joined where they run
/// between the same places in opposite directions: first between equal coordinates, then between those that differ by no more than
/// some roundings to float, 2⁻²⁰ of the largest coordinate. Where more than two meet, those are joined that have solid
/// between them, so that parts which touch stay apart.
///
/// `flat`: triangles without area and with three different corners, which may hold a surface together. Where it is open without them,
/// the corner between the two others becomes one of the neighbour beyond the longest side; one that this does not take in is left out.
/// Their number is returned in `left_out`.
TriangleMesh joined(TriangleMesh mesh, const std::vector<TriangleMesh::Triangle>& flat, std::size_t& left_out);

/// The edges of one triangle only that hang together: each gap's box, the largest first.
std::vector<Eigen::AlignedBox3d> gaps_of(const TriangleMesh& mesh);
/// The middle of an edge of MeshFaults::odd_edges, of which there is one.
Eigen::Vector3d odd_edge_of(const TriangleMesh& mesh);

}  // namespace twoport
