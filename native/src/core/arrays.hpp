// What comes from Python: arrays of numbers, whose sizes are checked.
#pragma once
#include "scene.hpp"
#include "want.hpp"
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <cstring>

namespace condyn
{
namespace nb = nanobind;
template<typename T, int axes>
using Array = nb::ndarray<T, nb::ndim<axes>, nb::c_contig, nb::device::cpu>;
using Table = Array<const double, 2>;
using List = Array<const double, 1>;

/// Whether an array has so many entries along each axis.
template<typename Numbers>
bool fits(const Numbers & x, std::initializer_list<std::size_t> shape)
{
  std::size_t axis = 0;
  for (std::size_t size : shape)
    if (x.shape(axis++) != size)
      return false;
  return true;
}

/// Where parts of some sizes are in numbers that have them one behind the other.
inline nb::dict parts_of(const std::vector<std::pair<const char *, std::size_t>> & sizes)
{
  nb::dict found;
  std::size_t begin = 0;
  for (const auto & [name, size] : sizes)
  {
    found[name] = nb::slice(begin, begin + size);
    begin += size;
  }
  return found;
}

/// Numbers of one state, all axes one behind the other. An array is asked for them by itself: an `nb::ndarray` takes
/// five times as long, and small robots are solved in as much.
class Numbers
{
public:
  Numbers(nb::handle array, int axes, bool to_write = false)
  {
    if (PyObject_GetBuffer(array.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (to_write ? PyBUF_WRITABLE : 0)))
      throw nb::python_error();
    if (view_.ndim != axes || std::strcmp(view_.format, "d") != 0)
    {
      PyBuffer_Release(&view_);
      throw std::invalid_argument("an array of other numbers, or of other axes");
    }
  }
  Numbers(const Numbers &) = delete;
  ~Numbers() { PyBuffer_Release(&view_); }

  std::size_t size() const { return view_.len / sizeof(double); }
  double * data() const { return static_cast<double *>(view_.buf); }

private:
  Py_buffer view_;
};

template<typename T>
auto row(const Array<T, 2> & x, std::size_t i)
{
  return Eigen::Map<std::conditional_t<std::is_const_v<T>, const VectorXd, VectorXd>>(
    x.data() + i * x.shape(1), x.shape(1));
}
} // namespace condyn
