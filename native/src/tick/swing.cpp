// The velocity after joints that are taken for rigid were locked at once, which keeps the momentum:
//
//   v + d,    d = d_0 + N z,    N^T M d = 0,    J_l d_0 = 0,    d_0 = -v of these joints
//
// `condyn_pin/control/limits.py` says why. The rows are those that are eliminated anyway, and N^T M N is positive
// definite where springs carry links without mass too.
#include "tick_program.hpp"
#include <Eigen/Cholesky>

namespace condyn
{
bool TickProgram::lock(VectorXd & v) const
{
  VectorXd s = VectorXd::Zero(rows_.rows());
  for (std::size_t i = 0; i < spec_.rigid.size(); ++i)
    s[spec_.held.size() + i] = -v[spec_.rigid[i]];
  const double swing = largest(s);
  if (swing == 0)
    return true;
  VectorXd d = elimination_.particular(s);
  const Eigen::LLT<MatrixXd> factor(inertia_);
  if (factor.info() != Eigen::Success)
    return false;
  d -= elimination_.N * factor.solve(elimination_.N.transpose() * (terms_.M * d));
  v += d;
  return largest(rows_ * d - s) <= spec_.rank * swing; // rows that were left out agree
}
} // namespace condyn
