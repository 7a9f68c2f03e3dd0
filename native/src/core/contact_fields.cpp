#include "candidates.hpp"
#include "fields.hpp"

namespace condyn
{
void fill(const Fields & x, ContactPoint & to)
{
  x("joint", to.joint)("ground", to.ground)("centre", to.centre)("radius", to.radius);
  x("plane", to.plane)("friction", to.friction);
}

/// Its points are the rows of arrays of Python.
void fill(const Fields & x, Shape & to)
{
  MatrixXd vertices, normals, directions;
  x("vertices", vertices)("edges", to.edges)("normals", normals)("heights", to.heights)("loops", to.loops);
  x("directions", directions)("radius", to.radius)("size", to.size)("reach", to.reach);
  for (const MatrixXd * points : {&vertices, &normals, &directions})
    want(points->cols() == 3, "shape");
  to.vertices = vertices.transpose(), to.normals = normals.transpose(), to.directions = directions.transpose();
  const int count = int(vertices.rows());
  want(count > 0 && to.heights.size() == normals.rows() && Eigen::Index(to.loops.size()) == normals.rows(), "shape");
  want(to.is_point() || !to.edges.empty(), "shape");
  const auto is_vertex = [count](int i) { return 0 <= i && i < count; };
  for (const Edge & edge : to.edges)
    want(is_vertex(edge[0]) && is_vertex(edge[1]), "vertex of a shape");
  for (const auto & loop : to.loops)
    want(loop.size() > 2 && std::all_of(loop.begin(), loop.end(), is_vertex), "face of a shape");
}

void fill(const Fields & x, Pair & to)
{
  x("joint", to.joint)("ground", to.ground)("placement", to.placement)("ground_placement", to.ground_placement);
  x("shape", to.shape)("ground_shape", to.ground_shape)("friction", to.friction);
}

void fill(const Fields & x, Stop & to) { x("iq", to.at_q)("iv", to.at_v)("sign", to.sign)("limit", to.limit); }

void fill(const Fields & x, Dry & to) { x("iv", to.at_v)("limit", to.limit); }

Candidates read_contacts(const Model & model, const Fields & x)
{
  return {model, x.get<std::vector<ContactPoint>>("touches"), x.get<std::vector<Pair>>("pairs"),
          x.get<std::vector<Stop>>("stops"), x.get<std::vector<Dry>>("dry")};
}
} // namespace condyn
