#include "scene_fields.hpp"
#include <map>

namespace condyn
{
namespace
{
using namespace pinocchio;

const std::map<std::string, Joint (*)(const JointSpec &)> kinds{
  {"JointModelRX", [](const JointSpec &) -> Joint { return JointModelRX(); }},
  {"JointModelRY", [](const JointSpec &) -> Joint { return JointModelRY(); }},
  {"JointModelRZ", [](const JointSpec &) -> Joint { return JointModelRZ(); }},
  {"JointModelPX", [](const JointSpec &) -> Joint { return JointModelPX(); }},
  {"JointModelPY", [](const JointSpec &) -> Joint { return JointModelPY(); }},
  {"JointModelPZ", [](const JointSpec &) -> Joint { return JointModelPZ(); }},
  {"JointModelFreeFlyer", [](const JointSpec &) -> Joint { return JointModelFreeFlyer(); }},
  {"JointModelSpherical", [](const JointSpec &) -> Joint { return JointModelSpherical(); }},
  {"JointModelRevoluteUnaligned", [](const JointSpec & x) -> Joint { return JointModelRevoluteUnaligned(x.angular()); }},
  {"JointModelPrismaticUnaligned", [](const JointSpec & x) -> Joint { return JointModelPrismaticUnaligned(x.linear()); }},
};

Joint joint(const JointSpec & spec)
{
  const auto found = kinds.find(spec.kind);
  want(found != kinds.end(), "the kind of a joint");
  return found->second(spec);
}
} // namespace

std::vector<std::string> joint_kinds()
{
  std::vector<std::string> names;
  for (const auto & [name, make] : kinds)
    names.push_back(name);
  return names;
}

void fill(const Fields & x, Constraint & to)
{
  const int kind = place_of(
    x.get<std::string>("kind"), {"held", "ball", "weld", "cut", "rod", "coupling", "roll"}, "kind of a constraint");
  const auto at_q = x.get<std::array<int, 2>>("at_q"), at_v = x.get<std::array<int, 2>>("at_v");
  to.kind = Kind(kind), to.q_a = at_q[0], to.q_b = at_q[1], to.v_a = at_v[0], to.v_b = at_v[1];
  int end;
  x.at("rows")("start", to.first)("stop", end);
  to.size = end - to.first;
  x("joint1", to.joint1)("joint2", to.joint2)("placement1", to.placement1)("placement2", to.placement2);
  x("selection", to.selection)("anchored", to.anchored)("sign", to.sign)("length", to.length)("offset", to.offset);
  x("axis", to.axis)("other_axis", to.other_axis)("is_hinge", to.is_hinge)("is_slider", to.is_slider);
}

void fill(const Fields & x, PlainSpec & to)
{
  x("size", to.size)("joint1", to.joint1)("joint2", to.joint2)("placement1", to.placement1);
  x("placement2", to.placement2)("anchored", to.anchored)("approximates", to.approximates);
}

void fill(const Fields & x, ProximalPlan & to)
{
  x("absolute", to.absolute)("relative", to.relative)("mu", to.mu)("limit", to.limit)("adaptive", to.patient);
  if (to.patient)
    x.at("better")("finer", to.finer)("usual", to.usual)("few", to.few)("usual_share", to.usual_share)(
      "few_share", to.few_share)("weak", to.weak)("strong", to.strong)("least", to.least)("harmless", to.harmless);
}

void fill(const Fields & x, SpringDamper & to)
{
  x("joint_a", to.joint_a)("joint_b", to.joint_b)("a", to.a)("b", to.b);
  x("stiffness", to.stiffness)("damping", to.damping)("rest_length", to.rest);
}

void fill(const Fields & x, JointSpring & to)
{
  x("at_q", to.at_q)("at_v", to.at_v)("stiffness", to.stiffness)("reference", to.reference);
}

void fill(const Fields & x, Verdict & to)
{
  x("gravity", to.gravity)("largest_weight", to.largest_weight)("per_row", to.per_row)("rounding", to.rounding);
  x("leaning", to.leaning)("leaning_forces", to.leaning_forces);
  x("negligible_constraint_error", to.negligible_constraint_error);
  x("plausible_acceleration", to.plausible_acceleration)("plausible_force", to.plausible_force);
  x("negligible_dynamics_error", to.negligible_dynamics_error);
  x("solved", to.solved)("loose", to.loose)("fastest", to.fastest);
}

void fill(const Fields & x, Precision & to)
{
  x("row_scales", to.R)("move_scales", to.D)("floor", to.floor)("least", to.least)("share", to.share)("open", to.open);
  x("moving", to.moving)("ajar", to.ajar)("doubt", to.doubt)("size", to.size);
  x("looks_independent", to.looks_independent)("idle", to.idle);
}

namespace
{
Passive passive_of(const Fields & x, const Model & model)
{
  Passive passive;
  x("damping", passive.d)("between", passive.between);
  want(passive.d.size() == model.nv, "damping");
  const auto springs = x.get<std::vector<JointSpring>>("springs");
  passive.k.resize(springs.size()), passive.rest.resize(springs.size());
  for (std::size_t s = 0; s < springs.size(); ++s)
  {
    const JointSpring & each = springs[s];
    want(0 <= each.at_q && each.at_q < model.nq && 0 <= each.at_v && each.at_v < model.nv, "place of a spring");
    passive.k[s] = each.stiffness, passive.rest[s] = each.reference;
    passive.at_q.push_back(each.at_q), passive.at_v.push_back(each.at_v);
  }
  for (const SpringDamper & each : passive.between)
    for (int joint : {each.joint_a, each.joint_b})
      want(0 <= joint && joint < model.njoints, "joint of a spring");
  return passive;
}

Scene read_model(const Fields & x)
{
  Scene scene;
  read_tree(x.at("tree"), scene.model, joint);
  x("kp", scene.kp)("kd", scene.kd);
  return scene;
}
} // namespace

Scene read_rows(const Fields & x)
{
  Scene scene = read_model(x);
  scene.weights = VectorXd::Zero(scene.model.nv);
  add_constraints(scene, x.get<std::vector<Constraint>>("constraints"), {});
  return scene;
}

Scene read_scene(const Fields & x)
{
  Scene scene = read_model(x);
  const int nv = scene.model.nv;
  x("to_scene", scene.to_scene)("weights", scene.weights)("verdict", scene.verdict);
  want(scene.weights.size() == nv, "weights");
  x("open_squared", scene.open_squared)("proximal", scene.proximal)("dependent", scene.rank.dependent);
  x("least_squared", scene.rank.least)("watched", scene.watched)("nominal_pivots", scene.nominal_pivots);
  scene.method = Method(place_of(x.get<std::string>("method"), {"proximal", "independent", "minimum_norm"}, "method"));
  want(Eigen::Index(scene.watched.size()) == scene.nominal_pivots.size(), "pivots");
  for (int i : scene.watched)
    want(0 <= i && i < nv, "pivots");
  scene.passive = passive_of(x, scene.model);
  add_constraints(scene, x.get<std::vector<Constraint>>("constraints"), x.get<std::vector<PlainSpec>>("plain"));
  x("precision", scene.precision);
  want(scene.precision.R.size() == scene.rows && scene.precision.D.size() == nv, "scales");
  for (int i : scene.precision.idle)
    want(0 <= i && i < scene.rows, "idle rows");
  MatrixXd wanted; // (3, rows), or (3, 0) where no row is driven
  x("wanted", wanted);
  want(wanted.rows() == 3 && (wanted.cols() == 0 || wanted.cols() == scene.rows), "wanted");
  want(wanted.cols() == 0 || scene.method != Method::proximal, "method of driven rows");
  if (wanted.cols())
    scene.wanted = wanted.transpose();
  return scene;
}

Path read_path(const Scene & scene, const Fields & x, int steps)
{
  Path path;
  Array<const double, 3> numbers;
  x("driven", path.rows)("path", numbers);
  const std::size_t count = path.rows.size();
  want((count > 0) == (scene.wanted.size() > 0), "number of driven rows");
  want(numbers.shape(1) == 3 && numbers.shape(2) == count, "path");
  want(count == 0 || (steps > 0 && numbers.shape(0) == 2 * std::size_t(steps) + 1), "steps of the path");
  for (int row : path.rows)
    want(0 <= row && row < scene.rows, "driven rows");
  path.numbers = numbers.data();
  return path;
}
} // namespace condyn
