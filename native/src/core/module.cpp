// What Python sees.
#include "core.hpp"
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

using namespace condyn;

NB_MODULE(_core, m)
{
  m.attr("pinocchio") = PINOCCHIO_VERSION;
  m.attr("simd") = Eigen::SimdInstructionSetsInUse();
  m.attr("arch") = CONDYN_ARCH;
  m.attr("protocol") = 1; // of the arrays: what condyn_pin hands over has to be of the same
  using namespace nanobind::literals;
  nb::class_<Core>(m, "Core")
    .def(nb::init<const std::vector<std::string> &, const Integers &, const Table &, const List &, const List &,
                  const IntegerTable &, const Table &, const IntegerTable &, const Table &, const Table &,
                  const List &, const List &, double, const List &>(),
         nb::kw_only(), "kinds"_a, "parents"_a, "joints"_a, "gravity"_a, "armature"_a, "constraints"_a,
         "of_constraints"_a, "plain"_a, "of_plain"_a, "to_scene"_a, "drift"_a, "weights"_a, "open_squared"_a,
         "proximal"_a)
    .def("solve", &Core::solve, "Q"_a, "V"_a, "TAU"_a, nb::kw_only(), "a"_a, "lam"_a, "sizes"_a, "iterations"_a,
         "times"_a, "threads"_a);
}
