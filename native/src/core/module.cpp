// What Python sees.
#include "contacts.hpp"
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

using namespace condyn;

namespace
{
/// ((residuals), iterations, seconds), which Python takes in half the time of an array; None where the state is left
/// to it.
nb::object said_of(const Answer & found)
{
  if (!found.clear)
    return nb::none();
  const Residuals & r = found.residuals;
  return nb::make_tuple(
    nb::make_tuple(r.dynamics, r.constraint, r.violation, r.velocity, r.bound), found.iterations, found.seconds);
}
} // namespace

NB_MODULE(_core, m)
{
  m.attr("pinocchio") = PINOCCHIO_VERSION;
  m.attr("simd") = Eigen::SimdInstructionSetsInUse();
  m.attr("arch") = CONDYN_ARCH;
  m.attr("protocol") = 12; // of the arrays: what condyn_pin hands over has to be of the same
  using namespace nanobind::literals;
  nb::class_<Core>(m, "Core")
    .def("__init__",
         [](Core * self, const std::vector<std::string> & kinds, const Integers & parents, const Table & joints,
            const List & gravity, const List & armature, const IntegerTable & constraints,
            const Table & of_constraints, const IntegerTable & plain, const Table & of_plain, const Table & to_scene,
            const List & drift, const List & weights, const List & verdict, double open_squared, int method, const List & proximal,
            const List & rank, const List & damping, const Table & springs, const IntegerTable & of_springs,
            const IntegerTable & between, const Table & of_between, const Integers & watched,
            const List & nominal_pivots, const Table & wanted, const List & row_scales, const List & move_scales,
            const List & precision, const Integers & idle) {
           new (self) Core({{kinds, parents, joints, gravity, armature, constraints, of_constraints, drift}, plain,
                            of_plain, to_scene, weights, verdict, open_squared, method, proximal, rank, damping, springs,
                            of_springs, between, of_between, watched, nominal_pivots, wanted, row_scales, move_scales,
                            precision, idle});
         },
         nb::kw_only(), "kinds"_a, "parents"_a, "joints"_a, "gravity"_a, "armature"_a, "constraints"_a,
         "of_constraints"_a, "plain"_a, "of_plain"_a, "to_scene"_a, "drift"_a, "weights"_a, "verdict"_a, "open_squared"_a,
         "method"_a, "proximal"_a, "rank"_a, "damping"_a, "springs"_a, "of_springs"_a, "between"_a, "of_between"_a,
         "watched"_a, "nominal_pivots"_a, "wanted"_a, "row_scales"_a, "move_scales"_a, "precision"_a, "idle"_a)
    .def(
      "solve",
      [](Core & core, const Table & Q, const Table & V, const Table & TAU, const Array<double, 2> & a,
         const Array<double, 2> & lam, const Array<double, 2> & residuals, const Array<int, 1> & iterations,
         const Array<int, 1> & clear, const Array<double, 1> & times, const IntegerTable & pushes,
         const Table & placements, const Table & wrenches, double accuracy, int threads) {
        core.solve({Q, V, TAU, pushes, placements, wrenches}, {a, lam, residuals, iterations, clear, times}, accuracy,
                   threads);
      },
      "Q"_a, "V"_a, "TAU"_a, nb::kw_only(), "a"_a, "lam"_a, "residuals"_a, "iterations"_a, "clear"_a, "times"_a,
      "pushes"_a, "placements"_a, "wrenches"_a, "accuracy"_a, "threads"_a)
    .def(
      "solve_one",
      [](Core & core, nb::handle q, nb::handle v, nb::handle tau, double accuracy, nb::handle out) {
        return said_of(core.solve_one({q, 1}, {v, 1}, {tau, 1}, accuracy, {out, 1, true}));
      },
      "q"_a, "v"_a, "tau"_a, "accuracy"_a, "out"_a)
    .def(
      "differentiate",
      [](Core & core, const Table & Q, const Table & V, const Table & TAU, const Array<double, 2> & a,
         const Array<double, 2> & lam, const Array<double, 2> & residuals, const Array<int, 1> & iterations,
         const Array<int, 1> & clear, const Array<double, 1> & times, const IntegerTable & pushes,
         const Table & placements, const Table & wrenches, const std::vector<Array<double, 3>> & blocks,
         double accuracy, int threads) {
        core.differentiate({Q, V, TAU, pushes, placements, wrenches}, {a, lam, residuals, iterations, clear, times},
                           blocks, accuracy, threads);
      },
      "Q"_a, "V"_a, "TAU"_a, nb::kw_only(), "a"_a, "lam"_a, "residuals"_a, "iterations"_a, "clear"_a, "times"_a,
      "pushes"_a, "placements"_a, "wrenches"_a, "blocks"_a, "accuracy"_a, "threads"_a)
    .def(
      "differentiate_one",
      [](Core & core, nb::handle q, nb::handle v, nb::handle tau, double accuracy, nb::handle out, nb::handle blocks) {
        return core.differentiate_one({q, 1}, {v, 1}, {tau, 1}, accuracy, {out, 1, true}, {blocks, 3, true});
      },
      "q"_a, "v"_a, "tau"_a, "accuracy"_a, "out"_a, "blocks"_a)
    .def(
      "simulate",
      [](Core & core, const Table & Q, const Table & V, const Table & TAU, int integrator, double dt, int steps,
         int every, int correct_every, bool with_answers, const List & limits, const Integers & driven,
         const Array<const double, 3> & path, const Array<double, 2> & t, const Array<double, 3> & q,
         const Array<double, 3> & v, const Array<double, 3> & a, const Array<double, 3> & lam,
         const Array<double, 3> & measures, const Array<int, 1> & done,
         const Array<double, 1> & times, int threads) {
        want(limits.size() == 6 && 0 <= integrator && integrator <= int(Integrator::runge_kutta_4), "plan");
        const double * x = limits.data();
        const MotionPlan plan{
          Integrator(integrator), dt, steps, every, correct_every, with_answers, x[0], x[1], x[2], x[3], int(x[4]),
          x[5], read_path(core.scene(), driven, path, steps)};
        core.simulate(Q, V, TAU, plan, {t, q, v, a, lam, measures, done, times}, threads);
      },
      "Q"_a, "V"_a, "TAU"_a, nb::kw_only(), "integrator"_a, "dt"_a, "steps"_a, "every"_a, "correct_every"_a,
      "with_answers"_a, "limits"_a, "driven"_a, "path"_a, "t"_a, "q"_a, "v"_a, "a"_a, "lam"_a, "measures"_a, "done"_a,
      "times"_a, "threads"_a);
  add_contacts(m);
}
