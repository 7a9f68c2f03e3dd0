#include "core.hpp"
#include "measures.hpp"
#include "threads.hpp"

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
  want(answers.residuals.shape(0) == n && answers.residuals.shape(1) == 5, "residuals");
  want(answers.clear.size() == n && answers.iterations.size() == n && answers.times.size() == n,
       "clear, iterations or times");
  const std::size_t forces = states.pushes.shape(0);
  want(states.pushes.shape(1) == 2 && states.placements.shape(0) == forces && states.placements.shape(1) == 12
         && states.wrenches.shape(0) == n && states.wrenches.shape(1) == 6 * forces, "forces");
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

void Core::load(const std::vector<Push> & found, int threads)
{
  prepare(threads);
  for (auto & worker : workers_)
    if (!worker->loads || !worker->loads->pushes.empty() || !found.empty())
      worker->loads = std::make_unique<Loads>(scene_.model, found);
}

Answer Core::answer(Worker & own, const double * forces, double accuracy) const
{
  const auto begun = std::chrono::steady_clock::now();
  own.loads->at(own.q, forces);
  const VectorXd & a = own.solver->acceleration(own.q, own.v, own.tau + own.loads->torque);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  own.lam = own.solver->scene_forces();
  const Sizes s = own.proof(own.q, own.v, own.tau, a, own.lam, own.loads.get(), own.solver->left);
  const Verdict & verdict = scene_.verdict;
  const double bound = verdict.bound(s);
  const bool clear = verdict.is_normalised(scene_.model, own.q) && s.changes < scene_.precision.doubt
                     && verdict.is_clear(s, bound, own.solver->pivots_left(), accuracy);
  return {a, own.lam, {s.dynamics, s.constraint, s.violation, s.velocity, bound}, clear, own.solver->iterations,
          seconds};
}

Answer Core::answer_row(
  Worker & own, std::size_t i, const States & states, const Answers & answers, double accuracy) const
{
  own.q = row(states.q, i), own.v = row(states.v, i), own.tau = row(states.tau, i);
  const Answer found = answer(own, states.wrenches.data() + i * states.wrenches.shape(1), accuracy);
  const Residuals & r = found.residuals;
  row(answers.a, i) = found.a, row(answers.lam, i) = found.lam;
  row(answers.residuals, i) << r.dynamics, r.constraint, r.violation, r.velocity, r.bound;
  answers.clear.data()[i] = found.clear;
  answers.iterations.data()[i] = found.iterations, answers.times.data()[i] = found.seconds;
  return found;
}

bool Core::differentiate(Worker & own, const Answer & found, double * const out[6]) const
{
  if (own.solver->left) // how that turns is known to Python
    return false;
  if (!own.derivatives)
    own.derivatives = std::make_unique<Derivatives>(scene_);
  return found.a.allFinite() && (*own.derivatives)(own.q, own.v, found.a, found.lam, *own.loads, own.proof.data(), out);
}

void Core::solve(const States & states, const Answers & answers, double accuracy, int threads)
{
  check(states, answers);
  load(pushes(states), threads);
  std::atomic<bool> stop{false};
  nb::gil_scoped_release released;
  share(states.q.shape(0), threads, stop, [&](int worker, std::size_t i) {
    answers.clear.data()[i] = 0;
    try
    {
      answer_row(*workers_[worker], i, states, answers, accuracy);
    }
    catch (...) // left to Python
    {
    }
  });
}

Worker & Core::hold(const Numbers & q, const Numbers & v, const Numbers & tau, const Numbers & out)
{
  const std::size_t nq = scene_.model.nq, nv = scene_.model.nv;
  want(q.size() == nq && v.size() == nv && tau.size() == nv, "q, v or tau");
  want(out.size() == nv + scene_.rows + nq + nv + 7, "out");
  load({}, 1);
  Worker & own = *workers_[0];
  own.q = In(q.data(), nq), own.v = In(v.data(), nv), own.tau = In(tau.data(), nv);
  return own;
}

Answer Core::answer_one(Worker & own, double accuracy, const Numbers & out) const
{
  const Answer found = answer(own, nullptr, accuracy);
  const Residuals & r = found.residuals;
  Out(out.data(), out.size()) << found.a, found.lam, own.q, own.v, r.dynamics, r.constraint, r.violation, r.velocity,
    r.bound, found.iterations, found.seconds;
  return found;
}

Answer Core::solve_one(
  const Numbers & q, const Numbers & v, const Numbers & tau, double accuracy, const Numbers & out)
{
  return answer_one(hold(q, v, tau, out), accuracy, out);
}

void Core::differentiate(const States & states, const Answers & answers,
  const std::vector<Array<double, 3>> & blocks, double accuracy, int threads)
{
  check(states, answers);
  const std::size_t n = states.q.shape(0), nv = scene_.model.nv;
  want(blocks.size() == 6, "number of blocks");
  for (int k = 0; k < 6; ++k)
    want(blocks[k].shape(0) == n && blocks[k].shape(1) == (k < 3 ? nv : std::size_t(scene_.rows))
           && blocks[k].shape(2) == nv, "a block");
  load(pushes(states), threads);
  std::atomic<bool> stop{false};
  nb::gil_scoped_release released;
  share(n, threads, stop, [&](int worker, std::size_t i) {
    int & clear = answers.clear.data()[i];
    clear = 0;
    try
    {
      Worker & own = *workers_[worker];
      const Answer found = answer_row(own, i, states, answers, accuracy);
      double * out[6];
      for (int k = 0; k < 6; ++k)
        out[k] = blocks[k].data() + i * nv * blocks[k].shape(1);
      clear = found.clear && differentiate(own, found, out);
    }
    catch (...) // left to Python
    {
      clear = 0;
    }
  });
}

bool Core::differentiate_one(const Numbers & q, const Numbers & v, const Numbers & tau, double accuracy,
  const Numbers & out, const Numbers & blocks)
{
  const std::size_t of_a = std::size_t(scene_.model.nv) * scene_.model.nv, whole = of_a + scene_.rows * scene_.model.nv;
  want(blocks.size() == 3 * whole, "blocks");
  Worker & own = hold(q, v, tau, out);
  const Answer found = answer_one(own, accuracy, out);
  double * at[6];
  for (int k = 0; k < 3; ++k)
    at[k] = blocks.data() + k * whole, at[3 + k] = at[k] + of_a;
  return found.clear && differentiate(own, found, at);
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
  want(fits(motions.q, kept, nq) && fits(motions.v, kept, nv) && fits(motions.measures, kept, measured), "samples");
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
        motions.measures.data() + i * kept * measured};
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
