// Rows of all tasks that are no equations, over the unknowns of a program: w |G^T x - b|^2, level after level.
#pragma once
#include <Eigen/Core>

namespace condyn
{
struct Wishes
{
  Eigen::MatrixXd G; // (n, r): a column a row of a task
  Eigen::VectorXd b, weights;
};
} // namespace condyn
