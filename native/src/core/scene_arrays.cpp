#include "scene_arrays.hpp"

namespace condyn
{
namespace
{
std::vector<JointSpec> joint_specs(
  const std::vector<std::string> & kinds, const Integers & parents, const Table & joints)
{
  want(joints.shape(0) == kinds.size() && parents.size() == kinds.size() && joints.shape(1) == 28, "joints");
  std::vector<JointSpec> specs;
  for (std::size_t i = 0; i < kinds.size(); ++i)
  {
    const double * x = row(joints, i).data(); // axis 3, placement 12, mass, lever 3, inertia 9
    specs.push_back({kinds[i], Vector3d(x), parents.data()[i], placement(x + 3), x[15], Vector3d(x + 16),
                     Matrix3d(x + 19)});
  }
  return specs;
}

std::vector<Constraint> constraint_specs(const IntegerTable & ints, const Table & numbers)
{
  want(ints.shape(0) == numbers.shape(0) && ints.shape(1) == 14 && numbers.shape(1) == 27, "constraints");
  std::vector<Constraint> specs;
  for (std::size_t i = 0; i < ints.shape(0); ++i)
  {
    const int * k = ints.data() + 14 * i;
    const double * x = row(numbers, i).data();
    want(0 <= k[0] && k[0] <= int(Kind::roll), "kind of a constraint");
    Constraint c{};
    c.kind = Kind(k[0]), c.first = k[1], c.size = k[2], c.joint1 = k[3], c.joint2 = k[4];
    for (int bit = 0; bit < 6; ++bit)
      if (k[5] >> bit & 1)
        c.selection.push_back(bit);
    c.anchored = k[6], c.axis = k[7], c.is_hinge = k[8], c.is_slider = k[9];
    c.q_a = k[10], c.q_b = k[11], c.v_a = k[12], c.v_b = k[13];
    c.placement1 = placement(x), c.placement2 = placement(x + 12);
    c.sign = x[24], c.length = x[25], c.offset = x[26];
    want(c.size == (c.is_scalar() ? 1 : int(c.selection.size())), "rows of a constraint");
    want(c.kind != Kind::ball || c.size == 3, "rows of a constraint");
    want(c.kind != Kind::weld || c.size == 6, "rows of a constraint");
    want((c.is_hinge ? 0 : -1) <= c.axis && c.axis < 3, "axis of a constraint");
    specs.push_back(c);
  }
  return specs;
}

std::vector<PlainSpec> plain_specs(const IntegerTable & ints, const Table & numbers)
{
  want(ints.shape(0) == numbers.shape(0) && ints.shape(1) == 5 && numbers.shape(1) == 24, "constraints of Pinocchio");
  std::vector<PlainSpec> specs;
  for (std::size_t i = 0; i < ints.shape(0); ++i)
  {
    const int * k = ints.data() + 5 * i;
    const double * x = row(numbers, i).data();
    specs.push_back({k[0], k[1], k[2], placement(x), placement(x + 12), bool(k[3]), bool(k[4])});
  }
  return specs;
}

ProximalPlan proximal_plan(const List & numbers)
{
  want(numbers.size() == 14, "proximal");
  const double * x = numbers.data();
  return {x[0], x[1], x[2], int(x[3]), bool(x[4]), x[5], int(x[6]), int(x[7]), x[8], x[9], x[10], x[11], x[12], x[13]};
}

std::vector<SpringDamper> spring_dampers(const IntegerTable & ints, const Table & numbers, int joints)
{
  want(ints.shape(0) == numbers.shape(0) && ints.shape(1) == 2 && numbers.shape(1) == 9, "springs between frames");
  std::vector<SpringDamper> specs;
  for (std::size_t i = 0; i < ints.shape(0); ++i)
  {
    const int * k = ints.data() + 2 * i;
    const double * x = row(numbers, i).data(); // origins 3 each, stiffness, damping, rest length
    want(0 <= k[0] && k[0] < joints && 0 <= k[1] && k[1] < joints, "joint of a spring");
    specs.push_back({k[0], k[1], Vector3d(x), Vector3d(x + 3), x[6], x[7], x[8]});
  }
  return specs;
}

Passive passive_of(const SceneArrays & x, const Model & model)
{
  const int nq = model.nq, nv = model.nv;
  want(int(x.damping.size()) == nv && x.springs.shape(0) == x.of_springs.shape(0), "damping, springs");
  want(x.springs.shape(1) == 2 && x.of_springs.shape(1) == 2, "springs");
  Passive passive;
  passive.d = vector(x.damping);
  passive.k.resize(x.springs.shape(0)), passive.rest.resize(x.springs.shape(0));
  for (std::size_t s = 0; s < x.springs.shape(0); ++s)
  {
    passive.k[s] = row(x.springs, s)[0], passive.rest[s] = row(x.springs, s)[1];
    const int at_q = x.of_springs.data()[2 * s], at_v = x.of_springs.data()[2 * s + 1];
    want(0 <= at_q && at_q < nq && 0 <= at_v && at_v < nv, "place of a spring");
    passive.at_q.push_back(at_q), passive.at_v.push_back(at_v);
  }
  passive.between = spring_dampers(x.between, x.of_between, model.njoints);
  return passive;
}

Verdict verdict_of(const List & numbers)
{
  want(numbers.size() == 13, "verdict");
  const double * x = numbers.data();
  return {x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11], x[12]};
}

Precision precision_of(const SceneArrays & x, const Scene & scene)
{
  want(int(x.row_scales.size()) == scene.rows && int(x.move_scales.size()) == scene.model.nv, "scales");
  want(x.precision.size() == 9, "precision");
  const double * p = x.precision.data();
  Precision found{vector(x.row_scales), vector(x.move_scales), int(p[0]), p[1], p[2], p[3], p[4], p[5], p[6], p[7],
                  bool(p[8]), {}};
  found.idle.assign(x.idle.data(), x.idle.data() + x.idle.size());
  for (int i : found.idle)
    want(0 <= i && i < scene.rows, "idle rows");
  return found;
}

Scene read_model(const RowArrays & x)
{
  Scene scene;
  want(x.gravity.size() == 3 && x.drift.size() == 2, "gravity, drift");
  scene.model = make_model(joint_specs(x.kinds, x.parents, x.joints), vector(x.gravity), vector(x.armature));
  scene.kp = x.drift.data()[0], scene.kd = x.drift.data()[1];
  return scene;
}
} // namespace

Scene read_rows(const RowArrays & x)
{
  Scene scene = read_model(x);
  scene.weights = VectorXd::Zero(scene.model.nv);
  add_constraints(scene, constraint_specs(x.constraints, x.of_constraints), {});
  return scene;
}

Scene read_scene(const SceneArrays & x)
{
  Scene scene = read_model(x);
  scene.to_scene = Eigen::Map<const RowMajor>(x.to_scene.data(), x.to_scene.shape(0), x.to_scene.shape(1));
  scene.weights = vector(x.weights);
  want(scene.weights.size() == scene.model.nv, "weights");
  scene.verdict = verdict_of(x.verdict);
  scene.open_squared = x.open_squared;
  scene.proximal = proximal_plan(x.proximal);
  want(x.rank.size() == 2, "rank");
  scene.rank = {bool(x.rank.data()[0]), x.rank.data()[1]};
  want(0 <= x.method && x.method <= int(Method::minimum_norm), "method");
  scene.method = Method(x.method);
  want(x.watched.size() == x.nominal_pivots.size(), "pivots");
  scene.watched.assign(x.watched.data(), x.watched.data() + x.watched.size());
  scene.nominal_pivots = vector(x.nominal_pivots);
  for (int i : scene.watched)
    want(0 <= i && i < scene.model.nv, "pivots");
  scene.passive = passive_of(x, scene.model);
  add_constraints(scene, constraint_specs(x.constraints, x.of_constraints), plain_specs(x.plain, x.of_plain));
  scene.precision = precision_of(x, scene);
  const std::size_t driven = x.wanted.shape(1);
  want(x.wanted.shape(0) == 3 && (driven == 0 || driven == std::size_t(scene.rows)), "wanted");
  want(driven == 0 || scene.method != Method::proximal, "method of driven rows");
  if (driven)
    scene.wanted = Eigen::Map<const RowMajor>(x.wanted.data(), 3, driven).transpose();
  return scene;
}

Path read_path(const Scene & scene, const Integers & rows, const Array<const double, 3> & path, int steps)
{
  want((rows.size() > 0) == (scene.wanted.size() > 0), "number of driven rows");
  want(path.shape(1) == 3 && path.shape(2) == rows.size(), "path");
  want(rows.size() == 0 || (steps > 0 && path.shape(0) == 2 * std::size_t(steps) + 1), "steps of the path");
  for (std::size_t i = 0; i < rows.size(); ++i)
    want(0 <= rows.data()[i] && rows.data()[i] < scene.rows, "driven rows");
  return {{rows.data(), rows.data() + rows.size()}, path.data()};
}
} // namespace condyn
