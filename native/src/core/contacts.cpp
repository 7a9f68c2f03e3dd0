#include "contacts.hpp"
#include "threads.hpp"
#include <utility>

namespace condyn
{
// ------------------------------------------------------------------------------------------------
// What crosses the border; `condyn_pin/stepping/batch.py` names where each comes from.

Candidates read_contacts(const Model & model, const Fields & x);

void fill(const Fields & x, ContactMethod & to)
{
  x("alternates", to.alternates)("newton_first", to.newton_first)("sticks_first", to.sticks_first);
  x("polish", to.polish)("steps", to.steps)("tolerance", to.directions.tolerance);
  x("max_iterations", to.directions.max_iterations)("anderson", to.directions.anderson);
  const Directions & by = to.directions;
  want(to.polish >= 0 && to.steps >= 0 && by.tolerance >= 0 && by.max_iterations >= 0 && by.anderson >= 0,
       "method of contacts");
}

void fill(const Fields & x, StepPlan & to)
{
  x("dt", to.dt)("method", to.method)("near", to.near)("pushed_out", to.pushed_out)("pushes", to.pushes);
  x("at_rest", to.at_rest)("touches", to.touches)("solved", to.solved)("moves", to.moves)("straight", to.straight);
  x("missed", to.missed)("closed", to.closed)("small", to.small)("rank", to.rank_tolerance)("deep", to.deep);
  x("not_driven", to.not_driven)("out_of_reach", to.out_of_reach);
  want(to.dt > 0, "dt");
}

void fill(const Fields & x, Steps & to)
{
  x("q", to.q)("v", to.v)("lam", to.lam)("errors", to.errors)("modes", to.modes)("done", to.done);
}

void fill(const Fields & x, Readings & to) { x("polished", to.polished)("falls", to.falls)("placed", to.placed); }

void fill(const Fields & x, Slopes & to)
{
  x("dq", to.dq)("dv", to.dv)("margins", to.margins)("read_modes", to.modes);
}

void fill(const Fields & x, Ways & to) { x("step", to.step)("Q", to.q)("V", to.v)("works", to.work)("TAU", to.tau); }

void fill(const Fields & x, MotionEnds & to)
{
  x("steps", to.steps)("every", to.every)("closed", to.closed)("lost", to.lost);
  want(to.steps > 0 && to.every > 0, "plan");
}

void fill(const Fields & x, ContactMotions & to)
{
  x("t", to.t)("q", to.q)("v", to.v)("a", to.a)("lam", to.lam)("contact", to.contact)("measures", to.measures);
  x("work", to.work)("done", to.done)("times", to.times);
}

StepPlan Contacts::plan(const Fields & x, int steps) const
{
  StepPlan found = x.get<StepPlan>("plan");
  found.path = read_path(scene_, x, steps);
  return found;
}

// ------------------------------------------------------------------------------------------------
// The work.

Contacts::Contacts(const Core & core, const Fields & x)
: scene_(core.scene()), candidates_(read_contacts(scene_.model, x)), rank_(x.get<int>("rank"))
{}

void Contacts::prepare(int threads)
{
  prepare_for(workers_, threads,
              [&](std::size_t) { return std::make_unique<ContactSteps>(scene_, candidates_, rank_); });
}

void Contacts::check(const States & states, const Steps & steps) const
{
  const std::size_t n = states.q.shape(0), nq = scene_.model.nq, nv = scene_.model.nv;
  want(fits(states.q, {n, nq}) && fits(states.v, {n, nv}) && fits(states.tau, {n, nv}), "q, v or tau");
  want(fits(steps.q, {n, nq}) && fits(steps.v, {n, nv})
         && fits(steps.lam, {n, std::size_t(scene_.rows + candidates_.rows())}), "q, v or lam");
  want(fits(steps.errors, {n, 8}) && fits(steps.modes, {n, std::size_t(candidates_.count())}) && fits(steps.done, {n}),
       "errors or modes");
}

/// Takes the step of a row, and says whether that was one.
bool Contacts::step(
  ContactSteps & own, std::size_t i, const States & states, const StepPlan & plan, const Steps & steps) const
{
  own.begin(plan, row(states.tau, i));
  if (!own.attempt(row(states.q, i), row(states.v, i)))
    return false;
  row(steps.q, i) = own.q, row(steps.v, i) = own.v, row(steps.lam, i) = own.impulses();
  Eigen::Map<Eigen::VectorXi>(steps.modes.data() + i * steps.modes.shape(1), candidates_.count()) = own.modes();
  own.errors(row(steps.errors, i).data());
  return row(steps.errors, i).allFinite();
}

void Contacts::step(const States & states, const StepPlan & plan, const Steps & steps, int threads)
{
  check(states, steps);
  prepare(threads);
  share_rows(steps.done, threads, [&](int worker, std::size_t i, const auto &) {
    return step(*workers_[worker], i, states, plan, steps);
  });
}

void Contacts::differentiate(
  const States & states, const StepPlan & plan, const Readings & readings, const Steps & steps,
  const Slopes & slopes, int threads)
{
  check(states, steps);
  const std::size_t n = states.q.shape(0), nv = scene_.model.nv, columns = slopes.dq.shape(2);
  const std::size_t filled = 3 * nv + candidates_.cones();
  want(columns >= filled && fits(slopes.dq, {n, nv, columns}) && fits(slopes.dv, {n, nv, columns}), "dq or dv");
  want(fits(slopes.margins, {n}) && fits(slopes.modes, {n, std::size_t(candidates_.count())}), "margins or modes");
  for (int each : readings.placed)
    want(0 <= each && each < scene_.rows, "rows with a place");
  prepare(threads);
  prepare_for(derivatives_, int(workers_.size()),
              [&](std::size_t i) { return std::make_unique<StepDerivatives>(*workers_[i]); });
  share_rows(steps.done, threads, [&](int worker, std::size_t i, const auto &) {
    StepDerivatives & of = *derivatives_[worker];
    if (!step(*workers_[worker], i, states, plan, steps) || !of(readings))
      return false;
    for (const auto & [to, from] : {std::pair(&slopes.dq, &of.dq), std::pair(&slopes.dv, &of.dv)})
      Eigen::Map<RowMajor>(to->data() + i * nv * columns, nv, columns).leftCols(filled) = *from;
    slopes.margins.data()[i] = of.margin;
    Eigen::Map<Eigen::VectorXi>(slopes.modes.data() + i * slopes.modes.shape(1), of.modes.size()) = of.modes;
    return true;
  });
}

void Contacts::simulate(
  const Ways & ways, const StepPlan & plan, const MotionEnds & ends, const ContactMotions & motions, int threads)
{
  const std::size_t n = ways.tau.shape(0), nq = scene_.model.nq, nv = scene_.model.nv, count = candidates_.count();
  const std::size_t kept = (ends.steps + ends.every - 1) / ends.every + 1, answers = motions.a.shape(1);
  want(fits(ways.q, {n, nq}) && fits(ways.v, {n, nv}) && fits(ways.tau, {n, nv}), "q, v or tau");
  want(fits(ways.step, {n}) && fits(ways.work, {n, 4}), "steps or work");
  want(fits(motions.t, {n, kept}) && fits(motions.work, {n, kept, 4}), "t or work");
  want(fits(motions.q, {n, kept, nq}) && fits(motions.v, {n, kept, nv}) && fits(motions.measures, {n, kept, measured}),
       "samples");
  want(answers == 0 || answers == kept, "a");
  want(!answers || (fits(motions.a, {n, kept, nv})
                    && fits(motions.lam, {n, kept, std::size_t(scene_.rows + candidates_.rows())})
                    && fits(motions.contact, {n, kept, 4 + count + !plan.path.rows.empty()})), "samples of answers");
  want(fits(motions.done, {n}) && fits(motions.times, {n}), "done or times");
  for (std::size_t i = 0; i < n; ++i)
    want(ways.step.data()[i] <= ends.steps, "steps");
  prepare(threads);
  share_rows(motions.done, threads, [&](int worker, std::size_t i, const std::atomic<bool> & stop) {
    int & step = ways.step.data()[i];
    if (motions.done.data()[i] || step < 0)
      return bool(motions.done.data()[i]);
    ContactSteps & own = *workers_[worker];
    const auto begun = std::chrono::steady_clock::now();
    Way way{std::exchange(step, -1), row(ways.q, i), row(ways.v, i), row(ways.work, i)};
    own.begin(plan, row(ways.tau, i));
    const bool done = run_motion(own, way, ends, plan.dt, motions, i, stop);
    step = way.step, row(ways.q, i) = way.q, row(ways.v, i) = way.v, row(ways.work, i) = way.work;
    motions.times.data()[i] += seconds_since(begun);
    return done;
  });
}

void add_contacts(nb::module_ & m)
{
  using namespace nanobind::literals;
  nb::class_<Contacts>(m, "Contacts")
    .def("__init__",
         [](Contacts * self, const Core & core, const nb::kwargs & x) { new (self) Contacts(core, Fields(x)); },
         nb::keep_alive<1, 2>(), "core"_a, "given"_a)
    .def("step",
         [](Contacts & contacts, const nb::kwargs & given) {
           const Fields x(given);
           contacts.step(x.as<States>(), contacts.plan(x, 1), x.as<Steps>(), x.get<int>("threads"));
         })
    .def("differentiate",
         [](Contacts & contacts, const nb::kwargs & given) {
           const Fields x(given);
           contacts.differentiate(x.as<States>(), contacts.plan(x, 1), x.as<Readings>(), x.as<Steps>(),
                                  x.as<Slopes>(), x.get<int>("threads"));
         })
    .def("simulate", [](Contacts & contacts, const nb::kwargs & given) {
      const Fields x(given);
      const MotionEnds ends = x.as<MotionEnds>();
      const int ahead = ends.steps % ends.every != 0; // the last sample is that of a step that is not taken
      contacts.simulate(x.as<Ways>(), contacts.plan(x, ends.steps + ahead), ends, x.as<ContactMotions>(),
                        x.get<int>("threads"));
    });
}
} // namespace condyn
