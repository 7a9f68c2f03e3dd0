// What Python sees.
#include "contacts.hpp"
#include <nanobind/stl/vector.h>

using namespace condyn;

namespace
{
/// What else Python makes a solution of; None where the state is left to it.
nb::object said_of(const Answer & found)
{
  if (!found.clear)
    return nb::none();
  const Residuals & r = found.residuals;
  nb::dict said;
  said["residuals"] = nb::make_tuple(r.dynamics, r.constraint, r.violation, r.velocity, r.bound);
  said["iterations"] = found.iterations, said["solve_time"] = found.seconds;
  return said;
}
} // namespace

NB_MODULE(_core, m)
{
  using namespace nanobind::literals;
  m.attr("pinocchio") = PINOCCHIO_VERSION;
  m.attr("simd") = Eigen::SimdInstructionSetsInUse();
  m.attr("arch") = CONDYN_ARCH;
  m.attr("protocol") = 13; // of the fields that cross the border: condyn_pin has to be of the same
  m.attr("joints") = joint_kinds();
  nb::dict columns; // of tables, by what is in them
  columns["residuals"] = nb::make_tuple("dynamics", "constraint", "violation", "velocity", "bound");
  columns["measures"] = nb::make_tuple("violation", "slip", "kinetic", "potential", "springs", "damping");
  columns["errors"] = nb::make_tuple("natural", "dynamics_error", "constraint_error", "violation", "penetration",
                                     "energy_lost", "correction_work", "algorithmic_work");
  columns["work"] = nb::make_tuple("contact", "correction", "algorithmic", "driven");
  m.attr("columns") = columns;
  nb::class_<Core>(m, "Core")
    .def("__init__", [](Core * self, const nb::kwargs & x) { new (self) Core(read_scene(Fields(x))); })
    .def_prop_ro("parts", &Core::parts)
    .def("solve",
         [](Core & core, const nb::kwargs & given) {
           const Fields x(given);
           core.solve(x.as<LoadedStates>(), x.as<Answers>(), x.get<double>("accuracy"), x.get<int>("threads"));
         })
    .def(
      "solve_one",
      [](Core & core, nb::handle q, nb::handle v, nb::handle tau, double accuracy, nb::handle out) {
        return said_of(core.solve_one({q, 1}, {v, 1}, {tau, 1}, accuracy, {out, 1, true}));
      },
      "q"_a, "v"_a, "tau"_a, "accuracy"_a, "out"_a)
    .def("differentiate",
         [](Core & core, const nb::kwargs & given) {
           const Fields x(given);
           core.differentiate(x.as<LoadedStates>(), x.as<Answers>(), x.get<std::vector<Array<double, 3>>>("blocks"),
                              x.get<double>("accuracy"), x.get<int>("threads"));
         })
    .def(
      "differentiate_one",
      [](Core & core, nb::handle q, nb::handle v, nb::handle tau, double accuracy, nb::handle out, nb::handle blocks) {
        return core.differentiate_one({q, 1}, {v, 1}, {tau, 1}, accuracy, {out, 1, true}, {blocks, 3, true});
      },
      "q"_a, "v"_a, "tau"_a, "accuracy"_a, "out"_a, "blocks"_a)
    .def("simulate", [](Core & core, const nb::kwargs & given) {
      const Fields x(given);
      MotionPlan plan = x.at("plan").as<MotionPlan>();
      plan.path = read_path(core.scene(), x, plan.steps);
      core.simulate(x.as<States>(), plan, x.as<Motions>(), x.get<int>("threads"));
    });
  add_contacts(m);
}
