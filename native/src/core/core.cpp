#include "core.hpp"
#include "measures.hpp"
#include "threads.hpp"

namespace condyn
{
void fill(const Fields & x, Push & to)
{
  x.at("place")("joint", to.joint)("placement", to.placement);
  x("in_world", to.in_world);
}

void fill(const Fields & x, States & to) { x("Q", to.q)("V", to.v)("TAU", to.tau); }

void fill(const Fields & x, LoadedStates & to)
{
  fill(x, static_cast<States &>(to));
  x("pushes", to.pushes)("wrenches", to.wrenches);
}

void fill(const Fields & x, Answers & to)
{
  x("a", to.a)("lam", to.lam)("residuals", to.residuals);
  x("iterations", to.iterations)("clear", to.clear)("times", to.times);
}

void fill(const Fields & x, Motions & to)
{
  x("t", to.t)("q", to.q)("v", to.v)("a", to.a)("lam", to.lam)("measures", to.measures);
  x("done", to.done)("times", to.times);
}

void fill(const Fields & x, MotionPlan & to)
{
  const std::string name = x.get<std::string>("integrator");
  to.integrator = Integrator(place_of(
    name, {"semi_implicit", "explicit_forces", "linear_midpoint", "implicit_midpoint", "runge_kutta_4"}, "integrator"));
  x("dt", to.dt)("steps", to.steps)("every", to.every)("correct_every", to.correct_every);
  x("with_answers", to.with_answers)("closed", to.closed)("largest", to.largest)("lost", to.lost)("reach", to.reach);
  x("rank", to.rank)("out_of_reach", to.out_of_reach);
}

void Core::check(const LoadedStates & states, const Answers & answers) const
{
  const std::size_t n = states.q.shape(0), nq = scene_.model.nq, nv = scene_.model.nv, rows = scene_.rows;
  want(fits(states.q, {n, nq}) && fits(states.v, {n, nv}) && fits(states.tau, {n, nv}), "q, v or tau");
  want(fits(answers.a, {n, nv}) && fits(answers.lam, {n, rows}) && fits(answers.residuals, {n, 5}),
       "a, lam or residuals");
  want(fits(answers.clear, {n}) && fits(answers.iterations, {n}) && fits(answers.times, {n}),
       "clear, iterations or times");
  want(fits(states.wrenches, {n, 6 * states.pushes.size()}), "forces");
  for (const Push & push : states.pushes)
    want(0 < push.joint && push.joint < scene_.model.njoints, "joint of a force");
}

nb::dict Core::parts() const
{
  const std::size_t nq = scene_.model.nq, nv = scene_.model.nv, rows = scene_.rows;
  return parts_of({{"a", nv}, {"lam", rows}, {"q", nq}, {"v", nv}, {"residuals", 5}, {"iterations", 1}, {"solve_time", 1}});
}

void Core::prepare(int threads)
{
  prepare_for(workers_, threads, [&](std::size_t) { return std::make_unique<Worker>(scene_); });
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
  const double seconds = seconds_since(begun);
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
  Worker & own, std::size_t i, const LoadedStates & states, const Answers & answers, double accuracy) const
{
  own.q = row(states.q, i), own.v = row(states.v, i), own.tau = row(states.tau, i);
  const Answer found = answer(own, states.wrenches.data() + i * states.wrenches.shape(1), accuracy);
  const Residuals & r = found.residuals;
  row(answers.a, i) = found.a, row(answers.lam, i) = found.lam;
  row(answers.residuals, i) << r.dynamics, r.constraint, r.violation, r.velocity, r.bound;
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

void Core::solve(const LoadedStates & states, const Answers & answers, double accuracy, int threads)
{
  check(states, answers);
  load(states.pushes, threads);
  share_rows(answers.clear, threads, [&](int worker, std::size_t i, const auto &) {
    return answer_row(*workers_[worker], i, states, answers, accuracy).clear;
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

void Core::differentiate(const LoadedStates & states, const Answers & answers,
  const std::vector<Array<double, 3>> & blocks, double accuracy, int threads)
{
  check(states, answers);
  const std::size_t n = states.q.shape(0), nv = scene_.model.nv;
  want(blocks.size() == 6, "number of blocks");
  for (int k = 0; k < 6; ++k)
    want(fits(blocks[k], {n, k < 3 ? nv : std::size_t(scene_.rows), nv}), "a block");
  load(states.pushes, threads);
  share_rows(answers.clear, threads, [&](int worker, std::size_t i, const auto &) {
    Worker & own = *workers_[worker];
    const Answer found = answer_row(own, i, states, answers, accuracy);
    double * out[6];
    for (int k = 0; k < 6; ++k)
      out[k] = blocks[k].data() + i * nv * blocks[k].shape(1);
    return found.clear && differentiate(own, found, out);
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

void Core::simulate(const States & states, const MotionPlan & plan, const Motions & motions, int threads)
{
  const std::size_t n = states.q.shape(0), nq = scene_.model.nq, nv = scene_.model.nv, rows = scene_.rows;
  want(plan.steps > 0 && plan.every > 0 && plan.dt > 0, "plan");
  const std::size_t kept = (plan.steps + plan.every - 1) / plan.every + 1, answers = plan.with_answers ? kept : 0;
  want(fits(states.q, {n, nq}) && fits(states.v, {n, nv}) && fits(states.tau, {n, nv}), "q, v or tau");
  want(fits(motions.t, {n, kept}) && fits(motions.q, {n, kept, nq}) && fits(motions.v, {n, kept, nv})
         && fits(motions.measures, {n, kept, measured}), "samples");
  want(fits(motions.a, {n, answers, nv}) && fits(motions.lam, {n, answers, rows}), "samples of answers");
  want(fits(motions.done, {n}) && fits(motions.times, {n}), "done or times");
  prepare(threads);
  share_rows(motions.done, threads, [&](int worker, std::size_t i, const std::atomic<bool> & stop) {
    Worker & own = *workers_[worker];
    if (!own.mover)
      own.mover = std::make_unique<Mover>(scene_);
    own.q = row(states.q, i), own.v = row(states.v, i), own.tau = row(states.tau, i);
    const Samples samples{
      motions.t.data() + i * kept, motions.q.data() + i * kept * nq, motions.v.data() + i * kept * nv,
      motions.a.data() + i * answers * nv, motions.lam.data() + i * answers * rows,
      motions.measures.data() + i * kept * measured};
    const auto begun = std::chrono::steady_clock::now();
    const bool done = own.mover->run(plan, own.q, own.v, own.tau, samples, stop);
    motions.times.data()[i] = seconds_since(begun);
    return done;
  });
}
} // namespace condyn
