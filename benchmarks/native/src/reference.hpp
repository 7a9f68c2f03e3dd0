// What is asked of every method, the converged answer, and how far from it a method ends.
#pragma once

#include "terms.hpp"

#include <Eigen/Core>
#include <optional>

namespace condyn
{

/// M X = F + Jᵀ lam,  J X = C.
///
/// One column for accelerations: F = tau - h, C = -gamma. Their derivatives with respect to tau
/// solve the same system with F = 1 and C = 0; without rows in J it is unconstrained dynamics.
struct Question
{
  Eigen::MatrixXd M, J, F, C;
};

struct Answer
{
  Eigen::MatrixXd X;
  std::optional<Eigen::MatrixXd> lam; // not every method gives one
  std::optional<int> iterations;
};

struct Errors
{
  double error;            // max |X - reference| / max(1, max |reference|)
  double dynamics_error;   // max |M X - F - Jᵀ lam|
  double constraint_error; // max |J X - C|, NaN without constraints
};

Question ask_for_acceleration(const Scene & scene);

/// Rank of J M^-1 Jᵀ, with the tolerance that the reference itself uses.
int rank(const Question & question);

/// If the answer has no lam, the best possible one (least squares) stands in for it.
Errors judge(const Question & question, const Answer & answer);

} // namespace condyn
