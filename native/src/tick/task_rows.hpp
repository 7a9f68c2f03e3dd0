// The rows of all tasks at a state: J a = b over accelerations, F lam = b over contact forces.
#pragma once
#include "tick_spec.hpp"
#include "tick_terms.hpp"

namespace condyn
{
/// The axes of the force of a contact in the world.
Matrix3d axes_of(const Constraint & contact, const Data & data);

class TaskRows
{
public:
  TaskRows(const Scene & scene, const TickSpec & spec);

  /// `numbers` are the references of all tasks.
  void at(TickTerms & terms, const double * numbers);

  MatrixXd J; // (rows, nv), zero in rows of forces
  MatrixXd F; // (rows, m_c), zero in rows of accelerations
  VectorXd b;

private:
  void of_frame(const Task & task, const TickTerms & terms, const double * x_r);
  void of_force(const Task & task, const Data & data, const double * x_r);
  void of_capture_point(const Task & task, const Vector3d & com, const Vector3d & com_velocity, const double * x_r);
  /// b of rows at x and v, J a + drift: `left` is x_r - x.
  void follow(const Task & task, const VectorXd & left, const VectorXd & v, const VectorXd & drift, const double * x_r);

  const Scene & scene_;
  const TickSpec & spec_;
  std::vector<std::vector<int>> moved_; // entries of v that move the frame of a task
  std::vector<int> place_; // of a row of the scene among those of contacts with a cone
  MatrixXd three_;
};
} // namespace condyn
