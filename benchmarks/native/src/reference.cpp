#include "reference.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>

#include <algorithm>
#include <limits>

namespace condyn
{
namespace
{

// On x86 these are 80 bits wide: what is left is the rounding of M, h, J and gamma, not the solve's.
using Real = long double;
using Matrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
using Decomposition = Eigen::CompleteOrthogonalDecomposition<Matrix>;

// Closed loops leave redundant directions of about their closure error (1e-12 or less), while the
// weakest real direction seen on robots is 1e-4.
const Real rank_tolerance = 1e-9L;

Decomposition decompose(const Matrix & matrix)
{
  Decomposition decomposition;
  decomposition.setThreshold(rank_tolerance);
  decomposition.compute(matrix);
  return decomposition;
}

/// With M = L Lᵀ and W = J L^-ᵀ the constraint is W (Lᵀ X) = C, and the redundant rows of W show.
struct Whitened
{
  explicit Whitened(const Question & question)
  : L(question.M.cast<Real>())
  , W(L.matrixL().solve(question.J.cast<Real>().transpose()).transpose())
  {
  }

  Eigen::LLT<Matrix> L;
  Matrix W;
};

Matrix reference(const Question & question)
{
  const Whitened whitened(question);
  Matrix Z = whitened.L.matrixL().solve(question.F.cast<Real>());
  if (question.J.rows() > 0)
    Z += decompose(whitened.W).solve(question.C.cast<Real>() - whitened.W * Z);
  return whitened.L.matrixU().solve(Z);
}

Matrix best_lam(const Question & question, const Matrix & excess)
{
  if (question.J.rows() == 0)
    return Matrix::Zero(0, excess.cols());
  return decompose(question.J.cast<Real>().transpose()).solve(excess);
}

Real largest(const Matrix & matrix)
{
  return matrix.size() == 0 ? 0.L : matrix.cwiseAbs().maxCoeff();
}

} // namespace

Question ask_for_acceleration(const Scene & scene)
{
  Terms terms(scene);
  terms.compute(scene.state);
  return {
    terms.M().selfadjointView<Eigen::Upper>(), terms.J(), scene.state.tau - terms.h(),
    -terms.gamma()};
}

int rank(const Question & question)
{
  if (question.J.rows() == 0)
    return 0;
  return static_cast<int>(decompose(Whitened(question).W).rank());
}

Errors judge(const Question & question, const Answer & answer)
{
  const Matrix X = answer.X.cast<Real>();
  const Matrix J = question.J.cast<Real>();
  const Matrix excess = question.M.cast<Real>() * X - question.F.cast<Real>();
  const Matrix lam = answer.lam ? Matrix(answer.lam->cast<Real>()) : best_lam(question, excess);
  const Matrix exact = reference(question);

  Errors errors;
  errors.error = static_cast<double>(largest(X - exact) / std::max(1.L, largest(exact)));
  errors.dynamics_error = static_cast<double>(largest(excess - J.transpose() * lam));
  errors.constraint_error = J.rows() > 0
                              ? static_cast<double>(largest(J * X - question.C.cast<Real>()))
                              : std::numeric_limits<double>::quiet_NaN();
  return errors;
}

} // namespace condyn
