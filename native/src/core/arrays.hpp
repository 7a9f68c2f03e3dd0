// What comes from Python: arrays of numbers, whose sizes are checked.
#pragma once
#include "scene.hpp"
#include "want.hpp"
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

namespace condyn
{
namespace nb = nanobind;
template<typename T, int axes>
using Array = nb::ndarray<T, nb::ndim<axes>, nb::c_contig, nb::device::cpu>;
using Table = Array<const double, 2>;
using List = Array<const double, 1>;
using Integers = Array<const int, 1>;
using IntegerTable = Array<const int, 2>;

inline VectorXd vector(const List & x) { return In(x.data(), x.size()); }

template<typename T>
auto row(const Array<T, 2> & x, std::size_t i)
{
  return Eigen::Map<std::conditional_t<std::is_const_v<T>, const VectorXd, VectorXd>>(
    x.data() + i * x.shape(1), x.shape(1));
}

/// 9 numbers of the rotation by rows, 3 of the translation.
inline SE3 placement(const double * x)
{
  SE3 M;
  M.rotation() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(x);
  M.translation() = Eigen::Map<const Vector3d>(x + 9);
  return M;
}
} // namespace condyn
