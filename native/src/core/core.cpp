#include "core.hpp"
#include "threads.hpp"
#include <cmath>
#include <limits>

namespace condyn
{
namespace
{
std::vector<JointSpec> joint_specs(const std::vector<std::string> & kinds, const Integers & parents, const Table & joints)
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
    want(0 <= k[0] && k[0] <= int(Kind::rolled), "kind of a constraint");
    Constraint c{};
    c.kind = Kind(k[0]), c.first = k[1], c.size = k[2], c.joint1 = k[3], c.joint2 = k[4];
    for (int bit = 0; bit < 6; ++bit)
      if (k[5] >> bit & 1)
        c.selection.push_back(bit);
    c.anchored = k[6], c.axis = k[7], c.is_hinge = k[8], c.is_slider = k[9];
    c.q_a = k[10], c.q_b = k[11], c.v_a = k[12], c.v_b = k[13];
    c.placement1 = placement(x), c.placement2 = placement(x + 12);
    c.sign = x[24], c.length = x[25], c.offset = x[26];
    const bool scalar = c.kind == Kind::rod || c.kind == Kind::coupling;
    want(c.size == (scalar ? 1 : int(c.selection.size())), "rows of a constraint");
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
} // namespace

Core::Core(
  const std::vector<std::string> & kinds, const Integers & parents, const Table & joints, const List & gravity,
  const List & armature, const IntegerTable & constraints, const Table & of_constraints,
  const IntegerTable & plain, const Table & of_plain, const Table & to_scene, const List & drift,
  const List & weights, double open_squared, const List & proximal)
{
  want(gravity.size() == 3 && drift.size() == 2, "gravity, drift");
  scene_.model = make_model(joint_specs(kinds, parents, joints), vector(gravity), vector(armature));
  scene_.kp = drift.data()[0], scene_.kd = drift.data()[1];
  scene_.to_scene = Eigen::Map<const RowMajor>(to_scene.data(), to_scene.shape(0), to_scene.shape(1));
  scene_.weights = vector(weights);
  want(scene_.weights.size() == scene_.model.nv, "weights");
  scene_.open_squared = open_squared;
  scene_.proximal = proximal_plan(proximal);
  add_constraints(scene_, constraint_specs(constraints, of_constraints), plain_specs(plain, of_plain));
}

void Core::check(const Table & Q, const Table & V, const Table & TAU) const
{
  const std::size_t n = Q.shape(0), nv = scene_.model.nv;
  want(Q.shape(1) == std::size_t(scene_.model.nq) && V.shape(1) == nv && TAU.shape(1) == nv, "width of q, v or tau");
  want(V.shape(0) == n && TAU.shape(0) == n, "number of v or tau");
}

void Core::prepare(int threads)
{
  if (threads < 1)
    throw std::invalid_argument("threads");
  while (int(workers_.size()) < threads)
    workers_.push_back(std::make_unique<Worker>(scene_));
}

void Core::solve(
  const Table & Q, const Table & V, const Table & TAU, const Array<double, 2> & a, const Array<double, 2> & lam,
  const Array<double, 2> & sizes, const Array<int, 1> & iterations, const Array<double, 1> & times, int threads)
{
  check(Q, V, TAU);
  const std::size_t n = Q.shape(0), nv = scene_.model.nv;
  want(a.shape(0) == n && a.shape(1) == nv && lam.shape(0) == n && lam.shape(1) == std::size_t(scene_.rows), "a or lam");
  want(sizes.shape(0) == n && sizes.shape(1) == 8 && iterations.size() == n && times.size() == n, "sizes");
  prepare(threads);
  std::atomic<bool> stop{false};
  nb::gil_scoped_release released;
  share(n, threads, stop, [&](int worker, std::size_t i) {
    Worker & own = *workers_[worker];
    auto found = row(sizes, i);
    try
    {
      own.q = row(Q, i), own.v = row(V, i), own.tau = row(TAU, i);
      const auto begun = std::chrono::steady_clock::now();
      const VectorXd & answer = own.solver.acceleration(own.q, own.v, own.tau);
      times.data()[i] = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
      const VectorXd forces = own.solver.scene_forces();
      const Sizes s = own.proof(own.q, own.v, own.tau, answer, forces);
      row(a, i) = answer;
      row(lam, i) = forces;
      iterations.data()[i] = own.solver.iterations;
      found << s.dynamics, s.a, s.violation, s.velocity, s.constraint, s.lam, s.weighted,
        own.solver.is_exact() ? 1.0 : 0.0;
    }
    catch (...) // its row says so: who asked looks at it by itself
    {
      found.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
  });
}
} // namespace condyn
