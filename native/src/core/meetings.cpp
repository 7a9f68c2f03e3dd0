#include "meetings.hpp"
#include "crossings.hpp"
#include <algorithm>
#include <numeric>

namespace condyn
{
namespace
{
constexpr int of_solids = 8, of_capsules = 5, of_capsule_and_solid = 4; // points at most
// as `ONE_POINT`, `EDGE_ON`, `CROSSING` of Python
constexpr double one_point = 1e-6, edge_on = 1e-6, crossing = 0.7;

Meetings turned(Meetings found)
{
  for (Meeting & m : found)
    m.point -= m.gap * m.normal, m.normal = -m.normal;
  return found;
}

void append(Meetings & found, const Meetings & more) { found.insert(found.end(), more.begin(), more.end()); }

/// By their gaps, without the digits that rounding makes.
std::vector<int> order_of(const Meetings & found)
{
  std::vector<int> order(found.size());
  std::iota(order.begin(), order.end(), 0);
  const auto rounded = [&](int i) { return std::rint(found[i].gap * 1e12); };
  std::stable_sort(order.begin(), order.end(), [&](int i, int j) { return rounded(i) < rounded(j); });
  return order;
}

Meetings taken(const Meetings & found, const std::vector<int> & chosen, std::size_t most)
{
  Meetings some;
  for (std::size_t k = 0; k < std::min(chosen.size(), most); ++k)
    some.push_back(found[chosen[k]]);
  return some;
}

/// Of an order, those whose point none before them has.
std::vector<int> distinct(const Meetings & found, const std::vector<int> & order, double size)
{
  std::vector<int> kept;
  for (std::size_t i = 0; i < order.size(); ++i)
    if (std::none_of(order.begin(), order.begin() + i, [&](int before) {
          return (found[before].point - found[order[i]].point).cwiseAbs().maxCoeff() <= one_point * size;
        }))
      kept.push_back(order[i]);
  return kept;
}

/// Where the balls round the corners of A meet B.
Meetings round_on(const Shape & A, const Shape & B)
{
  Meetings found;
  for (Eigen::Index i = 0; i < A.vertices.cols(); ++i)
  {
    const Length away = B.away(A.vertices.col(i));
    found.push_back(
      {away.length - A.radius - B.radius, A.vertices.col(i) - A.radius * away.along, away.along});
  }
  return found;
}

/// Where corners of B, and edges of both between their ends, are nearest to A; of cores that are apart.
Meetings between(const Shape & A, const Shape & B)
{
  Meetings found = turned(round_on(B, A));
  for (const Crossing & x : crossings(A, A.edges, B, B.edges, flat))
  {
    const Length apart(x.p - x.q);
    found.push_back({apart.length - A.radius - B.radius, x.p - A.radius * apart.along, apart.along});
  }
  return found;
}

// ------------------------------------------------------------------------------------------------
// Solids.

/// The axis along which two solids are furthest apart, how far, and whether edges give it.
struct Separation
{
  Vector3d axis;
  double gap;
  bool by_edges;
};

Separation separation(const Shape & A, const Shape & B)
{
  int face;
  const auto over = [&](const Shape & one, const Shape & two) { // each face of two by what is lowest of one
    return ((two.normals.transpose() * one.vertices).rowwise().minCoeff() - two.heights).eval().maxCoeff(&face);
  };
  const double margin = edge_on * std::max(A.size, B.size);
  const double over_B = over(A, B);
  Separation found{B.normals.col(face), over_B, false};
  if (A.is_solid())
    if (const double over_A = over(B, A); over_A > over_B + margin) // rounding must not choose among equals
      found = {-A.normals.col(face), over_A, false};
  Separation best{Vector3d::UnitZ(), -INFINITY, true};
  for (Eigen::Index i = 0; i < A.directions.cols(); ++i)
    for (Eigen::Index j = 0; j < B.directions.cols(); ++j)
    {
      const Length across(Vector3d(A.directions.col(i)).cross(Vector3d(B.directions.col(j))));
      if (!(across.length > flat))
        continue;
      const VectorXd along_A = A.vertices.transpose() * across.along, along_B = B.vertices.transpose() * across.along;
      const double above = along_A.minCoeff() - along_B.maxCoeff(), below = along_B.minCoeff() - along_A.maxCoeff();
      if (std::max(above, below) > best.gap)
        best.gap = std::max(above, below), best.axis = above >= below ? across.along : Vector3d(-across.along);
    }
  return best.gap > found.gap + margin ? best : found;
}

/// The corners that are over a face of B.
Meetings corners_on(const Shape & A, const std::vector<int> & corners, const Shape & B, int face)
{
  Meetings found;
  const Vector3d normal = B.normals.col(face);
  for (int i : corners)
  {
    const Vector3d corner = A.vertices.col(i);
    const double gap = corner.dot(normal) - B.heights[face];
    if (B.holds(corner - gap * normal))
      found.push_back({gap, corner, normal});
  }
  return found;
}

/// Where edges of A cross edges of B, one above the other along an axis.
Meetings edges_on_edges(
  const Shape & A, const Edges & of_A, const Shape & B, const Edges & of_B, const Vector3d & axis)
{
  Meetings found;
  for (const Crossing & x : crossings(A, of_A, B, of_B))
  {
    Vector3d normal = Length(x.d.cross(x.e)).along;
    const double cosine = normal.dot(axis);
    if (!(std::abs(cosine) > crossing))
      continue;
    if (cosine < 0)
      normal = -normal;
    found.push_back({(x.p - x.q).dot(normal), x.p, normal});
  }
  return found;
}

Edges around(const Shape & shape, int face)
{
  Edges found;
  const auto & loop = shape.loops[face];
  for (std::size_t i = 0; i < loop.size(); ++i)
    found.push_back({loop[i], loop[(i + 1) % loop.size()]});
  return found;
}

/// The edges whose middles are lowest along an axis.
Edges lowest(const Shape & shape, const Vector3d & axis)
{
  VectorXd along(shape.edges.size());
  for (Eigen::Index i = 0; i < along.size(); ++i)
    along[i] = shape.vertices.col(shape.edges[i][0]).dot(axis) + shape.vertices.col(shape.edges[i][1]).dot(axis);
  Edges found;
  const double most = along.minCoeff() + edge_on * shape.size;
  for (Eigen::Index i = 0; i < along.size(); ++i)
    if (along[i] <= most)
      found.push_back(shape.edges[i]);
  return found;
}

/// The corner of A that is first along an axis.
int first_along(const Shape & A, const Vector3d & axis)
{
  int first;
  VectorXd(A.vertices.transpose() * axis).minCoeff(&first);
  return first;
}

/// Where a solid A, or the segment of a capsule that is in B, meets a solid B.
Meetings solids(const Shape & A, const Shape & B, const Separation & apart)
{
  const Vector3d & axis = apart.axis;
  int top, bottom = 0;
  VectorXd(B.normals.transpose() * axis).maxCoeff(&top);
  std::vector<int> corners(A.vertices.cols());
  std::iota(corners.begin(), corners.end(), 0);
  Edges edges = A.edges;
  if (A.is_solid())
  {
    VectorXd(A.normals.transpose() * axis).minCoeff(&bottom);
    corners = A.loops[bottom], edges = around(A, bottom);
  }
  Meetings found = corners_on(A, corners, B, top);
  if (A.is_solid())
    append(found, turned(corners_on(B, B.loops[top], A, bottom)));
  append(found, edges_on_edges(A, edges, B, around(B, top), axis));
  if (apart.by_edges)
    append(found, edges_on_edges(A, lowest(A, axis), B, lowest(B, -axis), axis));
  const double size = std::max(A.size, B.size), margin = edge_on * size, over = apart.gap + margin;
  // what is deeper than the solids has a shorter way out, along what separates them
  found.erase(
    std::remove_if(found.begin(), found.end(), [&](const Meeting & m) { return m.gap < apart.gap - margin; }),
    found.end());
  if (std::all_of(found.begin(), found.end(), [&](const Meeting & m) { return m.gap > over; }))
  { // nothing is over what separates them
    Meetings first{{apart.gap, A.vertices.col(first_along(A, axis)), axis}};
    if (apart.gap > 0.0)
      first = round_on(A, B), append(first, between(A, B));
    append(found, taken(first, order_of(first), 1));
  }
  for (Meeting & m : found)
    m.gap -= A.radius, m.point -= A.radius * m.normal;
  std::vector<int> nearest = distinct(found, order_of(found), size);
  nearest.resize(std::min<std::size_t>(nearest.size(), of_solids));
  std::sort(nearest.begin(), nearest.end());
  return taken(found, nearest, of_solids);
}
} // namespace

int most_meetings(const Shape & A, const Shape & B)
{
  if (A.is_point() || B.is_point())
    return 1;
  if (A.is_solid() && B.is_solid())
    return of_solids;
  return A.is_solid() || B.is_solid() ? of_capsule_and_solid : of_capsules;
}

Meetings meetings(const Shape & A, const Shape & B)
{
  if (A.is_solid() && !B.is_solid())
    return turned(meetings(B, A));
  if (A.is_point())
    return round_on(A, B);
  if (B.is_point())
    return turned(round_on(B, A));
  if (B.is_solid())
    if (const Separation apart = separation(A, B); A.is_solid() || apart.gap < 0.0)
      return solids(A, B, apart);
  Meetings found = round_on(A, B);
  const Meetings more = between(A, B);
  append(found, B.is_solid() ? taken(more, order_of(more), 2) : more);
  std::vector<int> all(found.size());
  std::iota(all.begin(), all.end(), 0);
  return taken(found, distinct(found, all, std::max(A.size, B.size)), most_meetings(A, B));
}
} // namespace condyn
