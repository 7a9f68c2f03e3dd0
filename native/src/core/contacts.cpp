#include "contacts.hpp"
#include "threads.hpp"
#include <cmath>
#include <limits>
#include <nanobind/stl/vector.h>

namespace condyn
{
StepPlan Contacts::plan(
  const List & numbers, const Integers & driven, const Array<const double, 3> & path, int steps) const
{
  want(numbers.size() == 24, "plan of a step");
  const double * x = numbers.data();
  want(x[0] > 0, "dt");
  const auto counts = [](double y) { return 0 <= y && y <= std::numeric_limits<int>::max(); };
  want(counts(x[4]) && x[5] >= 0 && counts(x[6]) && counts(x[7]) && counts(x[8]), "method of contacts");
  const Directions directions{x[5], int(x[6]), int(x[7])};
  const ContactMethod method{x[1] != 0, x[2] != 0, x[3] != 0, int(x[4]), directions, int(x[8])};
  x += 9;
  return {numbers.data()[0], method, x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11], x[12],
          x[13], x[14], read_path(scene_, driven, path, steps)};
}

Contacts::Contacts(const Core & core, const ContactArrays & arrays, int rank)
: scene_(core.scene()), candidates_(read_contacts(scene_.model, arrays)), rank_(rank)
{}

template<typename Rows>
void Contacts::check(const Rows & q, const Rows & v, const Table & tau) const
{
  const std::size_t n = q.shape(0), nq = scene_.model.nq, nv = scene_.model.nv;
  want(q.shape(1) == nq && v.shape(1) == nv && tau.shape(1) == nv, "width of q, v or tau");
  want(v.shape(0) == n && tau.shape(0) == n, "number of v or tau");
}

void Contacts::prepare(int threads)
{
  if (threads < 0)
    throw std::invalid_argument("threads");
  while (int(workers_.size()) < std::max(threads, 1))
    workers_.push_back(std::make_unique<ContactSteps>(scene_, candidates_, rank_));
}

void Contacts::check(const States & states, const Steps & steps) const
{
  check(states.q, states.v, states.tau);
  const std::size_t n = states.q.shape(0), rows = scene_.rows + candidates_.rows();
  const auto fits = [&](const auto & x, std::size_t width) { return x.shape(0) == n && x.shape(1) == width; };
  want(fits(steps.q, scene_.model.nq) && fits(steps.v, scene_.model.nv) && fits(steps.lam, rows), "q, v or lam");
  want(fits(steps.errors, 8) && fits(steps.modes, candidates_.count()) && steps.done.size() == n, "errors or modes");
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
  std::atomic<bool> stop{false};
  nb::gil_scoped_release released;
  share(states.q.shape(0), threads, stop, [&](int worker, std::size_t i) {
    steps.done.data()[i] = 0;
    try
    {
      steps.done.data()[i] = step(*workers_[worker], i, states, plan, steps);
    }
    catch (...) // left to Python, which says why
    {
    }
  });
}

void Contacts::differentiate(
  const States & states, const StepPlan & plan, const Readings & readings, const Steps & steps,
  const Slopes & slopes, int threads)
{
  check(states, steps);
  const std::size_t n = states.q.shape(0), nv = scene_.model.nv, columns = slopes.dq.shape(2);
  const std::size_t filled = 3 * nv + candidates_.cones();
  for (const auto * x : {&slopes.dq, &slopes.dv})
    want(x->shape(0) == n && x->shape(1) == nv && x->shape(2) == columns && columns >= filled, "dq or dv");
  want(slopes.margins.size() == n && slopes.modes.shape(0) == n
         && slopes.modes.shape(1) == std::size_t(candidates_.count()), "margins or modes");
  for (int each : readings.placed)
    want(0 <= each && each < scene_.rows, "rows with a place");
  prepare(threads);
  while (derivatives_.size() < workers_.size())
    derivatives_.push_back(std::make_unique<StepDerivatives>(*workers_[derivatives_.size()]));
  std::atomic<bool> stop{false};
  nb::gil_scoped_release released;
  share(n, threads, stop, [&](int worker, std::size_t i) {
    steps.done.data()[i] = 0;
    try
    {
      StepDerivatives & of = *derivatives_[worker];
      if (!step(*workers_[worker], i, states, plan, steps) || !of(readings))
        return;
      for (const auto & [to, from] : {std::pair(&slopes.dq, &of.dq), std::pair(&slopes.dv, &of.dv)})
        Eigen::Map<RowMajor>(to->data() + i * nv * columns, nv, columns).leftCols(filled) = *from;
      slopes.margins.data()[i] = of.margin;
      Eigen::Map<Eigen::VectorXi>(slopes.modes.data() + i * slopes.modes.shape(1), of.modes.size()) = of.modes;
      steps.done.data()[i] = 1;
    }
    catch (...) // left to Python, which says why
    {
    }
  });
}

void Contacts::simulate(
  const Ways & ways, const Table & tau, const StepPlan & plan, const MotionEnds & ends,
  const ContactMotions & motions, int threads)
{
  check(ways.q, ways.v, tau);
  want(ends.steps > 0 && ends.every > 0, "plan");
  const std::size_t n = tau.shape(0), nq = scene_.model.nq, nv = scene_.model.nv;
  const std::size_t kept = (ends.steps + ends.every - 1) / ends.every + 1, answers = motions.a.shape(1);
  const auto fits = [&](const Array<double, 3> & x, std::size_t rows, std::size_t width) {
    return x.shape(0) == n && x.shape(1) == rows && x.shape(2) == width;
  };
  want(ways.step.size() == n && ways.work.shape(0) == n && ways.work.shape(1) == 4, "steps or work");
  want(motions.t.shape(0) == n && motions.t.shape(1) == kept && fits(motions.work, kept, 4), "t or work");
  want(fits(motions.q, kept, nq) && fits(motions.v, kept, nv) && fits(motions.measures, kept, measured), "samples");
  want(answers == 0 || answers == kept, "a");
  want(!answers || (fits(motions.a, kept, nv) && fits(motions.lam, kept, scene_.rows + candidates_.rows())
                    && fits(motions.contact, kept, 4 + candidates_.count() + !plan.path.rows.empty())),
       "samples of answers");
  want(motions.done.size() == n && motions.times.size() == n, "done or times");
  for (std::size_t i = 0; i < n; ++i)
    want(ways.step.data()[i] <= ends.steps, "steps");
  prepare(threads);
  std::atomic<bool> stop{false};
  nb::gil_scoped_release released;
  share(n, threads, stop, [&](int worker, std::size_t i) {
    ContactSteps & own = *workers_[worker];
    int & step = ways.step.data()[i];
    if (motions.done.data()[i] || step < 0)
      return;
    try
    {
      const auto begun = std::chrono::steady_clock::now();
      own.begin(plan, row(tau, i));
      Way way{step, row(ways.q, i), row(ways.v, i), row(ways.work, i)};
      motions.done.data()[i] = run_motion(own, way, ends, plan.dt, motions, i, stop);
      step = way.step, row(ways.q, i) = way.q, row(ways.v, i) = way.v, row(ways.work, i) = way.work;
      motions.times.data()[i] += std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
    }
    catch (...) // Python makes it again, and says why
    {
      step = -1;
    }
  });
}

void add_contacts(nb::module_ & m)
{
  using namespace nanobind::literals;
  nb::class_<Contacts>(m, "Contacts")
    .def("__init__",
         [](Contacts * self, const Core & core, const IntegerTable & touches, const Table & of_touches,
            const IntegerTable & pairs, const Table & of_pairs, const std::vector<Integers> & shapes,
            const std::vector<List> & of_shapes, const IntegerTable & stops, const Table & of_stops,
            const Integers & dry, const List & of_dry, int rank) {
           new (self) Contacts(core, {touches, of_touches, pairs, of_pairs, shapes, of_shapes, stops, of_stops, dry,
                                      of_dry}, rank);
         },
         nb::keep_alive<1, 2>(), "core"_a, nb::kw_only(), "touches"_a, "of_touches"_a, "pairs"_a, "of_pairs"_a,
         "shapes"_a, "of_shapes"_a, "stops"_a, "of_stops"_a, "dry"_a, "of_dry"_a, "rank"_a)
    .def(
      "step",
      [](Contacts & contacts, const Table & Q, const Table & V, const Table & TAU, const List & plan,
         const Integers & driven, const Array<const double, 3> & path, const Array<double, 2> & q,
         const Array<double, 2> & v, const Array<double, 2> & lam, const Array<double, 2> & errors,
         const Array<int, 2> & modes, const Array<int, 1> & done, int threads) {
        contacts.step({Q, V, TAU}, contacts.plan(plan, driven, path, 1), {q, v, lam, errors, modes, done}, threads);
      },
      "Q"_a, "V"_a, "TAU"_a, nb::kw_only(), "plan"_a, "driven"_a, "path"_a, "q"_a, "v"_a, "lam"_a, "errors"_a,
      "modes"_a, "done"_a, "threads"_a)
    .def(
      "differentiate",
      [](Contacts & contacts, const Table & Q, const Table & V, const Table & TAU, const List & plan,
         const Integers & driven, const Array<const double, 3> & path, double polished, double falls,
         const std::vector<int> & placed, const Array<double, 2> & q, const Array<double, 2> & v,
         const Array<double, 2> & lam, const Array<double, 2> & errors, const Array<int, 2> & modes,
         const Array<int, 1> & done, const Array<double, 3> & dq, const Array<double, 3> & dv,
         const Array<double, 1> & margins, const Array<int, 2> & read_modes, int threads) {
        contacts.differentiate({Q, V, TAU}, contacts.plan(plan, driven, path, 1), {polished, falls, placed},
                               {q, v, lam, errors, modes, done}, {dq, dv, margins, read_modes}, threads);
      },
      "Q"_a, "V"_a, "TAU"_a, nb::kw_only(), "plan"_a, "driven"_a, "path"_a, "polished"_a, "falls"_a, "placed"_a, "q"_a,
      "v"_a, "lam"_a, "errors"_a, "modes"_a, "done"_a, "dq"_a, "dv"_a, "margins"_a, "read_modes"_a, "threads"_a)
    .def(
      "simulate",
      [](Contacts & contacts, const Array<int, 1> & step, const Array<double, 2> & Q, const Array<double, 2> & V,
         const Array<double, 2> & works, const Table & TAU, const List & plan, const Integers & driven,
         const Array<const double, 3> & path, int steps, int every, double closed,
         double lost, const Array<double, 2> & t, const Array<double, 3> & q, const Array<double, 3> & v,
         const Array<double, 3> & a, const Array<double, 3> & lam, const Array<double, 3> & contact,
         const Array<double, 3> & measures, const Array<double, 3> & work, const Array<int, 1> & done,
         const Array<double, 1> & times, int threads) {
        const int ahead = steps % std::max(every, 1) != 0; // the last sample is that of a step that is not taken
        contacts.simulate({step, Q, V, works}, TAU, contacts.plan(plan, driven, path, steps + ahead),
                          {steps, every, closed, lost}, {t, q, v, a, lam, contact, measures, work, done, times},
                          threads);
      },
      nb::kw_only(), "step"_a, "Q"_a, "V"_a, "works"_a, "TAU"_a, "plan"_a, "driven"_a, "path"_a, "steps"_a, "every"_a,
      "closed"_a, "lost"_a, "t"_a, "q"_a, "v"_a, "a"_a, "lam"_a, "contact"_a, "measures"_a, "work"_a, "done"_a,
      "times"_a, "threads"_a);
}
} // namespace condyn
