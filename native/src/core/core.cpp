#include "core.hpp"
#include "threads.hpp"
#include <cmath>
#include <limits>

namespace condyn
{
Core::Core(const SceneArrays & arrays) : scene_(read_scene(arrays)) {}

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
