// What Python sees.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <pinocchio/config.hpp>
#include <Eigen/Core>

NB_MODULE(_core, m)
{
  m.attr("pinocchio") = PINOCCHIO_VERSION;
  m.attr("simd") = Eigen::SimdInstructionSetsInUse();
  m.attr("arch") = CONDYN_ARCH;
}
