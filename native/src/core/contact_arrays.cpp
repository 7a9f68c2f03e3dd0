#include "contact_arrays.hpp"

namespace condyn
{
namespace
{
std::vector<ContactPoint> touch_specs(const IntegerTable & ints, const Table & numbers)
{
  want(ints.shape(0) == numbers.shape(0) && ints.shape(1) == 2 && numbers.shape(1) == 17, "contact points");
  std::vector<ContactPoint> specs;
  for (std::size_t i = 0; i < ints.shape(0); ++i)
  {
    const int * k = ints.data() + 2 * i;
    const double * x = row(numbers, i).data(); // centre 3, radius, friction, plane 12
    specs.push_back({k[0], k[1], Vector3d(x), x[3], placement(x + 5), x[4]});
  }
  return specs;
}

/// Numbers of vertices, edges, faces and directions, the edges, and each face as its length and its vertices;
/// radius, size and reach, vertices, normals, heights and directions.
Shape shape_spec(const Integers & ints, const List & numbers)
{
  want(ints.size() >= 4, "shape");
  const int *k = ints.data(), *end = k + ints.size();
  const int vertices = k[0], edges = k[1], faces = k[2], directions = k[3];
  want(vertices > 0 && edges >= 0 && faces >= 0 && directions >= 0, "shape");
  want(numbers.size() == 3 + 3 * (std::size_t(vertices) + directions) + 4 * std::size_t(faces), "shape");
  const double * x = numbers.data() + 3;
  Shape shape;
  shape.radius = x[-3], shape.size = x[-2], shape.reach = x[-1];
  const auto points = [&x](int count) {
    const Points found = Eigen::Map<const Points>(x, 3, count);
    x += 3 * count;
    return found;
  };
  shape.vertices = points(vertices), shape.normals = points(faces);
  shape.heights = In(x, faces);
  x += faces;
  shape.directions = points(directions);
  k += 4;
  const auto vertex = [&] {
    want(k < end && 0 <= *k && *k < vertices, "vertex of a shape");
    return *k++;
  };
  for (int i = 0; i < edges; ++i)
  {
    const int one = vertex(), two = vertex();
    shape.edges.push_back({one, two});
  }
  for (int face = 0; face < faces; ++face)
  {
    want(k < end && *k > 2, "face of a shape");
    std::vector<int> loop(*k++);
    for (int & each : loop)
      each = vertex();
    shape.loops.push_back(loop);
  }
  want(k == end && (shape.is_point() || edges > 0), "shape");
  return shape;
}

std::vector<Pair> pair_specs(const ContactArrays & x)
{
  const std::size_t count = x.pairs.shape(0);
  want(x.of_pairs.shape(0) == count && x.pairs.shape(1) == 2 && x.of_pairs.shape(1) == 25, "pairs");
  want(x.shapes.size() == 2 * count && x.of_shapes.size() == 2 * count, "shapes of pairs");
  std::vector<Pair> specs;
  for (std::size_t i = 0; i < count; ++i)
  {
    const int * k = x.pairs.data() + 2 * i;
    const double * y = row(x.of_pairs, i).data(); // placements 12 each, friction
    specs.push_back({k[0], k[1], placement(y), placement(y + 12), shape_spec(x.shapes[2 * i], x.of_shapes[2 * i]),
                     shape_spec(x.shapes[2 * i + 1], x.of_shapes[2 * i + 1]), y[24]});
  }
  return specs;
}

std::vector<Stop> stop_specs(const IntegerTable & ints, const Table & numbers)
{
  want(ints.shape(0) == numbers.shape(0) && ints.shape(1) == 2 && numbers.shape(1) == 2, "stops");
  std::vector<Stop> specs;
  for (std::size_t i = 0; i < ints.shape(0); ++i)
    specs.push_back({ints.data()[2 * i], ints.data()[2 * i + 1], row(numbers, i)[0], row(numbers, i)[1]});
  return specs;
}

std::vector<Dry> dry_specs(const Integers & ints, const List & limits)
{
  want(ints.size() == limits.size(), "dry friction");
  std::vector<Dry> specs;
  for (std::size_t i = 0; i < ints.size(); ++i)
    specs.push_back({ints.data()[i], limits.data()[i]});
  return specs;
}
} // namespace

Candidates read_contacts(const Model & model, const ContactArrays & x)
{
  return {model, touch_specs(x.touches, x.of_touches), pair_specs(x), stop_specs(x.stops, x.of_stops),
          dry_specs(x.dry, x.of_dry)};
}
} // namespace condyn
