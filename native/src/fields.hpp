// Values of Python, whose fields are read by their names: keys of a dictionary, or attributes.
#pragma once
#include "pinocchio.hpp" // of the module
#include "want.hpp"
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <array>
#include <vector>

namespace condyn
{
namespace nb = nanobind;

/// The place of a word among those that are known.
inline int place_of(const std::string & word, const std::vector<std::string> & known, const char * what)
{
  for (std::size_t i = 0; i < known.size(); ++i)
    if (known[i] == word)
      return int(i);
  throw std::invalid_argument(std::string(what) + " " + word + " does not fit the scene");
}

class Fields
{
public:
  explicit Fields(nb::handle value) : value_(nb::borrow(value)) {}

  /// A value of its own; KeyError or AttributeError where there is none.
  Fields at(const char * name) const { return Fields(field(name)); }

  template<typename T>
  const Fields & operator()(const char * name, T & to) const
  {
    want(read(field(name), to), name);
    return *this;
  }

  template<typename T>
  T get(const char * name) const
  {
    T found{};
    (*this)(name, found);
    return found;
  }

  /// All of them, as `fill` has them for a type.
  template<typename T>
  T as() const
  {
    T found{};
    fill(*this, found);
    return found;
  }

private:
  nb::object field(const char * name) const
  {
    return PyDict_Check(value_.ptr()) ? nb::object(value_[name]) : nb::object(value_.attr(name));
  }

  static bool done()
  {
    const bool failed = PyErr_Occurred();
    PyErr_Clear();
    return !failed;
  }
  static bool read(nb::handle x, double & to) { return to = PyFloat_AsDouble(x.ptr()), done(); }
  static bool read(nb::handle x, bool & to) { return to = PyObject_IsTrue(x.ptr()) > 0, done(); }
  static bool read(nb::handle x, int & to)
  {
    const nb::object whole = nb::steal(PyNumber_Index(x.ptr()));
    const long found = whole.is_valid() ? PyLong_AsLong(whole.ptr()) : 0;
    return to = int(found), done() && to == found;
  }
  static bool read(nb::handle x, std::string & to) { return nb::try_cast(x, to); }

  /// Arrays of the caller: nothing is converted, and they live as long as he holds them.
  template<typename Scalar, typename... More>
  static bool read(nb::handle x, nb::ndarray<Scalar, More...> & to)
  {
    return nb::try_cast(x, to, false);
  }

  template<typename Matrix>
  static bool read(nb::handle x, Eigen::PlainObjectBase<Matrix> & to)
  {
    constexpr bool is_vector = Matrix::IsVectorAtCompileTime;
    nb::ndarray<const double, nb::device::cpu> from;
    if (!nb::try_cast(x, from) || from.ndim() != (is_vector ? 1 : 2))
      return false;
    const Eigen::Index rows = from.shape(0), columns = is_vector ? 1 : from.shape(is_vector ? 0 : 1);
    constexpr int most = Matrix::RowsAtCompileTime, most_columns = Matrix::ColsAtCompileTime;
    if ((most != Eigen::Dynamic && rows != most) || (most_columns != Eigen::Dynamic && columns != most_columns))
      return false;
    to.resize(rows, columns);
    for (Eigen::Index i = 0; i < rows; ++i)
      for (Eigen::Index j = 0; j < columns; ++j)
        to(i, j) = from.data()[i * from.stride(0) + (is_vector ? 0 : j * from.stride(is_vector ? 0 : 1))];
    return true;
  }

  static bool read(nb::handle x, pinocchio::SE3 & to)
  {
    return read(x.attr("rotation"), to.rotation()) && read(x.attr("translation"), to.translation());
  }

  template<typename T>
  static bool read(nb::handle x, std::vector<T> & to)
  {
    to.clear();
    for (nb::handle each : nb::iter(x))
      if (!read(each, to.emplace_back()))
        return false;
    return true;
  }
  template<typename T, std::size_t size>
  static bool read(nb::handle x, std::array<T, size> & to)
  {
    std::vector<T> found;
    if (!read(x, found) || found.size() != size)
      return false;
    std::copy(found.begin(), found.end(), to.begin());
    return true;
  }

  template<typename T>
  static auto read(nb::handle x, T & to) -> decltype(fill(std::declval<const Fields &>(), to), true)
  {
    return fill(Fields(x), to), true;
  }

  nb::object value_;
};

/// A joint and its body, of any list of joints.
struct JointSpec
{
  std::string kind; // shortname, as Pinocchio says it
  int parent;
  Eigen::Matrix<double, 6, 2> S; // what it moves along at its neutral place, if by two coordinates at most
  pinocchio::SE3 placement; // in the parent
  double mass; // [kg]
  Eigen::Vector3d lever; // centre of mass [m]
  Eigen::Matrix3d inertia; // about it [kg m^2]

  Eigen::Vector3d linear() const { return S.col(0).head<3>(); }
  Eigen::Vector3d angular(int column = 0) const { return S.col(column).tail<3>(); }
};

inline void fill(const Fields & x, JointSpec & to)
{
  x("kind", to.kind)("parent", to.parent)("subspace", to.S)("placement", to.placement);
  x("mass", to.mass)("lever", to.lever)("inertia", to.inertia);
}

/// A tree, of joints that `make` makes; std::invalid_argument where something does not fit.
template<typename Model, typename Make>
void read_tree(const Fields & x, Model & model, Make && make)
{
  for (const JointSpec & spec : x.get<std::vector<JointSpec>>("joints"))
  {
    want(0 <= spec.parent && spec.parent < model.njoints, "the order of joints");
    const auto id = model.addJoint(spec.parent, make(spec), spec.placement, "j" + std::to_string(model.njoints));
    // Written, not appended: appending to nothing would round.
    model.inertias[id] = pinocchio::Inertia(spec.mass, spec.lever, pinocchio::Symmetric3(spec.inertia));
  }
  Eigen::Vector3d gravity;
  Eigen::VectorXd armature;
  x("gravity", gravity)("armature", armature);
  want(armature.size() == model.nv, "armature");
  model.gravity.linear() = gravity;
  model.armature = armature;
}
} // namespace condyn
