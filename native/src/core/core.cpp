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
    want(-1 <= c.axis && c.axis < 3, "axis of a constraint");
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
  const List & weights, double open_squared, int method, const List & proximal, const List & rank,
  const List & damping, const Table & springs, const IntegerTable & of_springs, const Integers & watched,
  const List & nominal_pivots)
{
  want(gravity.size() == 3 && drift.size() == 2, "gravity, drift");
  scene_.model = make_model(joint_specs(kinds, parents, joints), vector(gravity), vector(armature));
  scene_.kp = drift.data()[0], scene_.kd = drift.data()[1];
  scene_.to_scene = Eigen::Map<const RowMajor>(to_scene.data(), to_scene.shape(0), to_scene.shape(1));
  scene_.weights = vector(weights);
  want(scene_.weights.size() == scene_.model.nv, "weights");
  scene_.open_squared = open_squared;
  scene_.proximal = proximal_plan(proximal);
  want(rank.size() == 2, "rank");
  scene_.rank = {bool(rank.data()[0]), rank.data()[1]};
  want(0 <= method && method <= int(Method::minimum_norm), "method");
  scene_.method = Method(method);
  const int nq = scene_.model.nq, nv = scene_.model.nv;
  want(int(damping.size()) == nv && springs.shape(0) == of_springs.shape(0), "damping, springs");
  want(springs.shape(1) == 2 && of_springs.shape(1) == 2, "springs");
  want(watched.size() == nominal_pivots.size(), "pivots");
  scene_.watched.assign(watched.data(), watched.data() + watched.size());
  scene_.nominal_pivots = vector(nominal_pivots);
  for (int i : scene_.watched)
    want(0 <= i && i < nv, "pivots");
  scene_.passive.d = vector(damping);
  scene_.passive.k.resize(springs.shape(0)), scene_.passive.rest.resize(springs.shape(0));
  for (std::size_t s = 0; s < springs.shape(0); ++s)
  {
    scene_.passive.k[s] = row(springs, s)[0], scene_.passive.rest[s] = row(springs, s)[1];
    const int at_q = of_springs.data()[2 * s], at_v = of_springs.data()[2 * s + 1];
    want(0 <= at_q && at_q < nq && 0 <= at_v && at_v < nv, "place of a spring");
    scene_.passive.at_q.push_back(at_q), scene_.passive.at_v.push_back(at_v);
  }
  add_constraints(scene_, constraint_specs(constraints, of_constraints), plain_specs(plain, of_plain));
}

void Core::check(const States & states, const Answers & answers) const
{
  const std::size_t n = states.q.shape(0), nv = scene_.model.nv;
  want(states.q.shape(1) == std::size_t(scene_.model.nq) && states.v.shape(1) == nv && states.tau.shape(1) == nv,
       "width of q, v or tau");
  want(states.v.shape(0) == n && states.tau.shape(0) == n, "number of v or tau");
  want(answers.a.shape(0) == n && answers.a.shape(1) == nv, "a");
  want(answers.lam.shape(0) == n && answers.lam.shape(1) == std::size_t(scene_.rows), "lam");
  want(answers.sizes.shape(0) == n && answers.sizes.shape(1) == 9, "sizes");
  want(answers.iterations.size() == n && answers.times.size() == n, "iterations or times");
  const std::size_t forces = states.pushes.shape(0);
  want(states.pushes.shape(1) == 2 && states.placements.shape(0) == forces && states.placements.shape(1) == 12
         && states.wrenches.shape(0) == n && states.wrenches.shape(1) == 6 * forces, "forces");
  want(answers.loads.shape(0) == n && answers.loads.shape(1) == nv, "loads");
}

std::vector<Push> Core::pushes(const States & states) const
{
  std::vector<Push> found;
  for (std::size_t i = 0; i < states.pushes.shape(0); ++i)
  {
    const int * k = states.pushes.data() + 2 * i;
    want(0 < k[0] && k[0] < scene_.model.njoints, "joint of a force");
    found.push_back({k[0], placement(row(states.placements, i).data()), bool(k[1])});
  }
  return found;
}

void Core::prepare(int threads)
{
  if (threads < 0)
    throw std::invalid_argument("threads");
  while (int(workers_.size()) < std::max(threads, 1))
    workers_.push_back(std::make_unique<Worker>(scene_));
}

void Core::load(const States & states, int threads)
{
  prepare(threads);
  const auto found = pushes(states);
  for (auto & worker : workers_)
    if (!worker->loads || !worker->loads->pushes.empty() || !found.empty())
      worker->loads = std::make_unique<Loads>(scene_.model, found);
}

const VectorXd & Core::answer(Worker & own, std::size_t i, const States & states, const Answers & answers) const
{
  own.q = row(states.q, i), own.v = row(states.v, i), own.tau = row(states.tau, i);
  const auto begun = std::chrono::steady_clock::now();
  own.loads->at(own.q, states.wrenches.data() + i * states.wrenches.shape(1));
  const VectorXd & a = own.solver->acceleration(own.q, own.v, own.tau + own.loads->torque);
  answers.times.data()[i] = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  const VectorXd lam = own.solver->scene_forces();
  const Sizes s = own.proof(own.q, own.v, own.tau, a, lam, own.loads.get());
  row(answers.loads, i) = own.loads->size;
  row(answers.a, i) = a;
  row(answers.lam, i) = lam;
  answers.iterations.data()[i] = own.solver->iterations;
  row(answers.sizes, i) << s.dynamics, s.a, s.violation, s.velocity, s.constraint, s.lam, s.weighted,
    own.solver->is_exact() ? 1.0 : 0.0, own.solver->pivots_left();
  return a;
}

namespace
{
/// What a row says of which nothing is known: who asked looks at it by itself.
void give_up(const Answers & answers, std::size_t i)
{
  row(answers.sizes, i).setConstant(std::numeric_limits<double>::quiet_NaN());
}
} // namespace

void Core::solve(const States & states, const Answers & answers, int threads)
{
  check(states, answers);
  load(states, threads);
  std::atomic<bool> stop{false};
  nb::gil_scoped_release released;
  share(states.q.shape(0), threads, stop, [&](int worker, std::size_t i) {
    try
    {
      answer(*workers_[worker], i, states, answers);
    }
    catch (...)
    {
      give_up(answers, i);
    }
  });
}

Eigen::Matrix<double, 11, 1> Core::solve_one(
  const List & q, const List & v, const List & tau, const Array<double, 1> & a, const Array<double, 1> & lam)
{
  const std::size_t nv = scene_.model.nv;
  want(q.size() == std::size_t(scene_.model.nq) && v.size() == nv && tau.size() == nv, "q, v or tau");
  want(a.size() == nv && lam.size() == std::size_t(scene_.rows), "a or lam");
  prepare(1);
  Worker & own = *workers_[0];
  own.q = vector(q), own.v = vector(v), own.tau = vector(tau);
  const auto begun = std::chrono::steady_clock::now();
  const VectorXd & found = own.solver->acceleration(own.q, own.v, own.tau);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  const VectorXd forces = own.solver->scene_forces();
  const Sizes s = own.proof(own.q, own.v, own.tau, found, forces);
  Out(a.data(), nv) = found;
  Out(lam.data(), scene_.rows) = forces;
  Eigen::Matrix<double, 11, 1> sizes;
  sizes << s.dynamics, s.a, s.violation, s.velocity, s.constraint, s.lam, s.weighted,
    own.solver->is_exact() ? 1.0 : 0.0, own.solver->pivots_left(), double(own.solver->iterations), seconds;
  return sizes;
}

void Core::differentiate(
  const States & states, const Answers & answers, const std::vector<Array<double, 3>> & blocks, int threads)
{
  check(states, answers);
  const std::size_t n = states.q.shape(0), nv = scene_.model.nv;
  want(blocks.size() == 6, "number of blocks");
  for (int k = 0; k < 6; ++k)
    want(blocks[k].shape(0) == n && blocks[k].shape(1) == (k < 3 ? nv : std::size_t(scene_.rows))
           && blocks[k].shape(2) == nv, "a block");
  load(states, threads);
  std::atomic<bool> stop{false};
  nb::gil_scoped_release released;
  share(n, threads, stop, [&](int worker, std::size_t i) {
    Worker & own = *workers_[worker];
    try
    {
      const VectorXd & a = answer(own, i, states, answers);
      if (!own.derivatives)
        own.derivatives = std::make_unique<Derivatives>(scene_);
      double * out[6];
      for (int k = 0; k < 6; ++k)
        out[k] = blocks[k].data() + i * nv * blocks[k].shape(1);
      const VectorXd lam = row(answers.lam, i);
      if (!a.allFinite() || !(*own.derivatives)(own.q, own.v, a, lam, *own.loads, own.proof.data(), out))
        give_up(answers, i);
    }
    catch (...)
    {
      give_up(answers, i);
    }
  });
}

void Core::simulate(
  const Table & Q, const Table & V, const Table & TAU, const MotionPlan & plan, const Motions & motions, int threads)
{
  const std::size_t n = Q.shape(0), nq = scene_.model.nq, nv = scene_.model.nv;
  want(plan.steps > 0 && plan.every > 0 && plan.dt > 0, "plan");
  const std::size_t kept = (plan.steps + plan.every - 1) / plan.every + 1, answers = plan.with_answers ? kept : 0;
  want(Q.shape(1) == nq && V.shape(1) == nv && TAU.shape(1) == nv, "width of q, v or tau");
  want(V.shape(0) == n && TAU.shape(0) == n, "number of v or tau");
  const auto fits = [&](const Array<double, 3> & x, std::size_t rows, std::size_t width) {
    return x.shape(0) == n && x.shape(1) == rows && x.shape(2) == width;
  };
  want(motions.t.shape(0) == n && motions.t.shape(1) == kept, "t");
  want(fits(motions.q, kept, nq) && fits(motions.v, kept, nv) && fits(motions.measures, kept, 4), "samples");
  want(fits(motions.a, answers, nv) && fits(motions.lam, answers, scene_.rows), "samples of answers");
  want(motions.done.size() == n && motions.times.size() == n, "done or times");
  prepare(threads);
  std::atomic<bool> stop{false};
  nb::gil_scoped_release released;
  share(n, threads, stop, [&](int worker, std::size_t i) {
    Worker & own = *workers_[worker];
    motions.done.data()[i] = 0;
    try
    {
      if (!own.mover)
        own.mover = std::make_unique<Mover>(scene_);
      own.q = row(Q, i), own.v = row(V, i), own.tau = row(TAU, i);
      const Samples samples{
        motions.t.data() + i * kept, motions.q.data() + i * kept * nq, motions.v.data() + i * kept * nv,
        motions.a.data() + i * answers * nv, motions.lam.data() + i * answers * scene_.rows,
        motions.measures.data() + i * kept * 4};
      const auto begun = std::chrono::steady_clock::now();
      motions.done.data()[i] = own.mover->run(plan, own.q, own.v, own.tau, samples, stop);
      motions.times.data()[i] = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
    }
    catch (...) // given up: Python makes it again, and says why
    {
    }
  });
}
} // namespace condyn
