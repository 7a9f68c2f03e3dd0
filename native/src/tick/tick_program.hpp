// The quadratic program of a control tick, over what is left after held rows and torques are eliminated.
//
//   x = (z, lam_c / m, w / m),     a = a_0 + N z,     t / m = T x + t_0
//
// `condyn_pin/control/program.py` says what each is, in the same order of rows.
#pragma once
#include "elimination.hpp"
#include "quadratic_program.hpp"
#include "task_rows.hpp"
#include "wishes.hpp"

namespace condyn
{
class TickProgram
{
public:
  TickProgram(const Scene & scene, const TickSpec & spec);

  /// False where Python has to look. `numbers` are the references of all tasks.
  bool at(const VectorXd & q, VectorXd v, const VectorXd & passive, const double * numbers);
  /// a, the torques of the motors, lam of all rows, and the torques of joints that are taken for rigid.
  void recover(const VectorXd & x, VectorXd & a, VectorXd & tau, VectorXd & lam, VectorXd & rigid) const;
  /// J a + drift - a_wanted of all tasks, or F lam - f_wanted.
  VectorXd errors(const VectorXd & a, const VectorXd & lam) const;

  QuadraticProgram qp; // without an objective where there are several levels
  Wishes wishes; // of those
  double unreached = 0; // how far contacts with redundant rows are from what they demand
  const TickTerms & terms() const { return terms_; }

private:
  /// What is held, eliminated from accelerations; false where a rank is in doubt.
  bool hold();
  /// Takes the swing of joints that are taken for rigid out of v; false where rows contradict each other.
  bool lock(VectorXd & v) const;
  /// The equations of motion over x.
  void eliminate();
  void write_equations();
  void write_along();
  void write_objective();
  void write_wishes();
  void write_inequalities();
  void write_accelerations(Eigen::Index first);
  bool turn_cones();

  const Scene & scene_;
  const TickSpec & spec_;
  TickTerms terms_;
  TaskRows tasks_;
  Elimination elimination_;
  std::vector<int> others_; // entries of v without a motor
  bool holds_; // whether anything is eliminated
  enum { unknown, independent, redundant } contacts_ = unknown;
  MatrixXd rows_, inertia_, J_c_, touch_, force_, torque_, law_, along_, cones_; // inertia: N^T M N
  VectorXd a_0_, demanded_, torque_0_, law_0_, passive_;
};
} // namespace condyn
