// The border to Python: fields in, arrays in and out.
#include "method.hpp"

#include <nanobind/stl/vector.h>

#include <limits>

namespace condyn
{
namespace
{

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using WrittenTable = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

/// A scene and one way to solve it, for one thread.
class Bound
{
public:
  Bound(const std::string & method, const Fields & x)
  : scene_(read_scene(x))
  , method_(make_method(method, scene_, {x.get<double>("mu"), x.get<double>("accuracy"), x.get<int>("limit")}))
  {
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
  namespace nb = nanobind;
  using condyn::Bound;
  m.attr("pinocchio") = PINOCCHIO_VERSION;
  m.attr("eigen") = std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION)
                    + "." + std::to_string(EIGEN_MINOR_VERSION);
  m.attr("simd") = Eigen::SimdInstructionSetsInUse();
  m.attr("compiler") = CONDYN_COMPILER;
  m.attr("joints") = condyn::joint_kinds();
  m.attr("methods") = condyn::method_names();
  nb::class_<Bound>(m, "Bound")
    .def("__init__", [](Bound * self, const std::string & method, const nb::kwargs & x) {
      new (self) Bound(method, condyn::Fields(x));
    })
    .def("solve", &Bound::solve)
    .def("solve_many", &Bound::solve_many)
    .def("lam", &Bound::lam);
}
