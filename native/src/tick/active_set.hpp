// The answer of a quadratic program by its active set.
//
// With G the equations and the active rows, d their bounds, and y all their multipliers,
//
//   [H  G^T] [dx]   [-(H x + g + G^T y)]
//   [G   0 ] [dy] = [     d - G x      ],       x += dx,  y += dy,
//
// repeated until what is left is rounding. With H = L L^T, factorised once a program, and
// L^-1 G^T = Q R, columns of Q orthonormal, r and s the two right sides and u = L^-1 r,
//
//   p = Q^T u - R^-T s,    dy = R^-1 p,    dx = L^-T (u - Q p).
//
// Rows that depend on those before them are left out. The active set is first that of the last program,
// changed as the primal-dual active-set method does (Hintermueller, Ito, Kunisch 2002); where that does not
// end, the dual method of Goldfarb and Idnani (1983) begins anew, one row at a time.
#pragma once
#include "quadratic_program.hpp"
#include <Eigen/Cholesky>
#include <limits>
#include <vector>

namespace condyn
{
constexpr double none = std::numeric_limits<double>::infinity(); // what is left where there is no answer
constexpr double dependent = 1e-9; // what is left of a row, relative, that is a combination of others

/// On which side of an inequality an answer is: at its lower bound, between, at its upper one.
enum Side : signed char { at_lower = -1, between = 0, at_upper = 1 };

class ActiveSet
{
public:
  /// Returns the KKT residual of the answer; it counts if that is below `enough`. NaN or infinite where
  /// there is none. `sides` (r,) are those to begin from, and then those of the answer.
  double solve(const QuadraticProgram & program, std::vector<Side> & sides, double enough);

  VectorXd x, z; // the answer, and multipliers of the inequalities: z > 0 at an upper bound
  int changes = 0; // of the active set

private:
  /// A row that is violated, or -1; on which side, and by how much.
  struct Violated
  {
    int row;
    Side side;
    double by;
  };

  /// L, and Q and R of the equations; false if there is no L.
  bool factorise();
  /// Q and R of the equations and of the active rows.
  void gather();
  /// What is left of a column (n,) beyond those in Q: it is taken out, and `shares` says how much of each it had.
  void take_out(VectorXd & column, VectorXd & shares) const;
  /// Appends a row to Q and R, unless it depends on those that are there.
  bool append(VectorXd column, const Eigen::Ref<const VectorXd> & row, double bound);
  /// Appends an inequality, with its `column` L^-1 C; false if it depends on the active ones.
  bool activate(int row, Side side, const VectorXd & column);
  /// The answer with the active rows as equations, from the x and multipliers that are there.
  double refine();
  /// Makes rows active that are violated, and others free whose multiplier has the wrong sign.
  bool change();
  /// Goldfarb and Idnani's method; false where rows contradict each other.
  bool dual();
  /// Moves until a row is no longer violated, or until one has to leave first, which is returned, or -1;
  /// false where neither can be.
  bool step(Violated & it, int & leaves);
  Violated most_violated() const;
  /// The row whose multiplier is the first to change its sign, or -1; `length` becomes that of the way there.
  int first_to_leave(const VectorXd & rates, double & length) const;
  template<typename Columns> void forward(Columns && columns) const;
  template<typename Columns> void backward(Columns && columns) const;

  const QuadraticProgram * program_ = nullptr;
  std::vector<Side> * sides_ = nullptr;
  Eigen::LLT<MatrixXd> first_, others_; // of the two blocks of H
  MatrixXd Q_, R_, G_; // their first `count_` columns
  VectorXd bound_, multipliers_; // of the rows in G
  Eigen::Index count_ = 0, equations_ = 0;
  std::vector<int> active_; // inequalities behind the equations in G
};

template<typename Columns>
void ActiveSet::forward(Columns && columns) const
{
  const auto split = program_->split;
  first_.matrixL().solveInPlace(columns.topRows(split));
  others_.matrixL().solveInPlace(columns.bottomRows(columns.rows() - split));
}

template<typename Columns>
void ActiveSet::backward(Columns && columns) const
{
  const auto split = program_->split;
  first_.matrixU().solveInPlace(columns.topRows(split));
  others_.matrixU().solveInPlace(columns.bottomRows(columns.rows() - split));
}
} // namespace condyn
