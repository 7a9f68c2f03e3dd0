// The border to Python: arrays of numbers in and out, no object of anybody's Pinocchio.
#include "method.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <limits>
#include <stdexcept>

namespace nb = nanobind;
using namespace nb::literals;

namespace condyn
{
namespace
{

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using WrittenTable = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Integers = nb::ndarray<const int, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

void want(bool fits, const char * what)
{
  if (!fits)
    throw std::invalid_argument(what);
}

/// Reads a row of numbers from left to right.
class Reader
{
public:
  Reader(const Table & table, std::size_t row)
  : at_(table.data() + row * table.shape(1))
  {
  }

  double number() { return *at_++; }

  /// Of matrices the rows one after the other.
  template<int rows, int columns>
  Eigen::Matrix<double, rows, columns> matrix()
  {
    Eigen::Matrix<double, rows, columns> found;
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < columns; ++j)
        found(i, j) = number();
    return found;
  }

  pinocchio::SE3 placement()
  {
    const Eigen::Matrix3d R = matrix<3, 3>();
    return {R, matrix<3, 1>()};
  }

private:
  const double * at_;
};

const std::size_t joint_width = 12 + 12 + 1 + 3 + 9, constraint_width = 12 + 12 + 2;

std::vector<JointNumbers>
read_joints(const std::vector<std::string> & kinds, const std::vector<int> & parents, const Table & numbers)
{
  want(parents.size() == kinds.size(), "parents: one for each joint is needed");
  want(numbers.shape(0) == kinds.size() && numbers.shape(1) == joint_width,
       "joints: a row of 37 numbers for each is needed");
  std::vector<JointNumbers> joints;
  for (std::size_t i = 0; i < kinds.size(); ++i)
  {
    Reader read(numbers, i);
    JointNumbers joint;
    joint.kind = kinds[i];
    joint.parent = parents[i];
    joint.S = read.matrix<6, 2>();
    joint.placement = read.placement();
    joint.mass = read.number();
    joint.lever = read.matrix<3, 1>();
    joint.inertia = read.matrix<3, 3>();
    joints.push_back(joint);
  }
  return joints;
}

std::vector<ConstraintNumbers> read_constraints(const Integers & integers, const Table & numbers)
{
  want(integers.shape(1) == 3 && numbers.shape(1) == constraint_width
         && numbers.shape(0) == integers.shape(0),
       "constraints: a row of 3 integers and one of 26 numbers for each are needed");
  std::vector<ConstraintNumbers> constraints;
  for (std::size_t k = 0; k < numbers.shape(0); ++k)
  {
    const int * rows_and_joints = integers.data() + 3 * k;
    Reader read(numbers, k);
    ConstraintNumbers constraint;
    constraint.rows = rows_and_joints[0];
    constraint.joint1 = rows_and_joints[1];
    constraint.joint2 = rows_and_joints[2];
    constraint.placement1 = read.placement();
    constraint.placement2 = read.placement();
    constraint.Kp = read.number();
    constraint.Kd = read.number();
    constraints.push_back(constraint);
  }
  return constraints;
}

/// A scene and one way to solve it, for one thread.
class Bound
{
public:
  Bound(
    const std::string & method,
    const std::vector<std::string> & kinds, const std::vector<int> & parents, const Table & joints,
    const Vector & gravity, const Vector & armature,
    const Integers & constraint_integers, const Table & constraint_numbers,
    double mu, double accuracy, int limit)
  {
    want(gravity.size() == 3, "gravity: three numbers are needed");
    scene_ = make_scene(
      read_joints(kinds, parents, joints), Eigen::Vector3d(gravity.data()),
      In(armature.data(), Eigen::Index(armature.size())),
      read_constraints(constraint_integers, constraint_numbers));
    method_ = make_method(method, scene_, {mu, accuracy, limit});
  }
  Bound(const Bound &) = delete;

  int solve(const Vector & q, const Vector & v, const Vector & tau, const Written & a)
  {
    check(q.size(), v.size(), tau.size(), a.size());
    return method_->solve(in(q), in(v), in(tau), Out(a.data(), scene_.model.nv));
  }

  /// One state a row. Where a matrix is singular a is not a number.
  void solve_many(const Table & Q, const Table & V, const Table & TAU, const WrittenTable & A)
  {
    const std::size_t count = Q.shape(0);
    want(V.shape(0) == count && TAU.shape(0) == count && A.shape(0) == count, "Q, V, TAU, A: not as many rows");
    check(Q.shape(1), V.shape(1), TAU.shape(1), A.shape(1));
    nb::gil_scoped_release released;
    const int nq = scene_.model.nq, nv = scene_.model.nv;
    for (std::size_t i = 0; i < count; ++i)
    {
      Out a(A.data() + i * nv, nv);
      const In q(Q.data() + i * nq, nq), v(V.data() + i * nv, nv), tau(TAU.data() + i * nv, nv);
      if (method_->solve(q, v, tau, a) == 0)
        a.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
  }

  void lam(const Written & lam) const
  {
    want(int(lam.size()) == scene_.rows, "lam: one number for each row is needed");
    Out(lam.data(), scene_.rows) = method_->lam;
  }

private:
  static In in(const Vector & x) { return In(x.data(), Eigen::Index(x.size())); }

  void check(std::size_t q, std::size_t v, std::size_t tau, std::size_t a) const
  {
    const auto nq = std::size_t(scene_.model.nq), nv = std::size_t(scene_.model.nv);
    want(q == nq && v == nv && tau == nv && a == nv, "q, v, tau, a: of another size");
  }

  Scene scene_;
  MethodPtr method_;
};

} // namespace
} // namespace condyn

NB_MODULE(CONDYN_MODULE, m)
{
  using condyn::Bound;
  m.attr("pinocchio") = PINOCCHIO_VERSION;
  m.attr("eigen") = std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION)
                    + "." + std::to_string(EIGEN_MINOR_VERSION);
  m.attr("simd") = Eigen::SimdInstructionSetsInUse();
  m.attr("compiler") = CONDYN_COMPILER;
  m.attr("joints") = condyn::joint_kinds();
  m.attr("methods") = condyn::method_names();
  nb::class_<Bound>(m, "Bound")
    .def(nb::init<
           const std::string &, const std::vector<std::string> &, const std::vector<int> &,
           const condyn::Table &, const condyn::Vector &, const condyn::Vector &,
           const condyn::Integers &, const condyn::Table &, double, double, int>(),
         "method"_a, "kinds"_a, "parents"_a, "joints"_a, "gravity"_a, "armature"_a,
         "constraint_integers"_a, "constraint_numbers"_a, nb::kw_only(), "mu"_a, "accuracy"_a, "limit"_a)
    .def("solve", &Bound::solve)
    .def("solve_many", &Bound::solve_many)
    .def("lam", &Bound::lam);
}
