// What a control tick is about, as numbers: tasks, cones, motors and limits; none of it changes from tick to tick.
// `condyn_pin/control/compiled.py` makes it.
#pragma once
#include "scene.hpp"

namespace condyn
{
/// What the rows of a task are of; `condyn_pin/control/tasks/task.py` has their names.
enum class TaskKind {
  position, orientation, pose, center_of_mass, joint, posture, angular_momentum, contact_force, capture_point
};

/// w |J a + drift - a_r - kp (x_r - x) - kd (v_r - v)|^2, or w |F lam - x_r|^2 of a contact force.
///
/// Of a capture point kp and kd are k and omega, and x_r is where the mass belongs in the axes of the floor and E by
/// rows, with which E d is 1 where the pressure is at an edge (`condyn_pin/control/tasks/capture_point.py`).
struct Task
{
  TaskKind kind;
  int first, size; // rows among those of all tasks
  int at; // the joint of its frame; where q holds a joint; or the constraint
  bool hard; // rows that are equations
  SE3 placement; // of its frame on the joint, or of the floor
  double kp, kd, weight;
  std::vector<int> columns; // of v, a row each, where rows are entries of a
  int reference, of_x, of_v; // where x_r begins among the numbers of a tick, and sizes: x_r, v_r, a_r

  bool is_force() const { return kind == TaskKind::contact_force; }
  bool is_selection() const { return !columns.empty(); }
};

/// A cone A T lam <= 0 whose axes T turn with the robot.
struct TurningCone
{
  int constraint; // the contact
  int row, column; // of its block among the rows of all cones, and the forces of all contacts
  int edge; // the axis of an edge, or -1: T = floor R
  Matrix3d floor; // its rows are the axes of the floor in the world; of an edge the first is the vertical
  MatrixXd A; // over forces and moments in the axes of the floor
  MatrixXd to_wrench; // what the rows of the constraint transmit as force, or force and moment
};

/// Bounds of accelerations of entries of v.
struct AccelerationLimits
{
  std::vector<int> columns;
  VectorXd most, speed; // of all entries of v
  double dt; // how far joints look ahead [s]; 0 for those that do not
  std::vector<int> at_q, at_v; // of joints with limits
  VectorXd lowest, highest;
};

struct TickSpec
{
  std::vector<Task> tasks; // level after level, and then those that are equations
  std::vector<int> levels; // rows of each
  int task_rows = 0, numbers = 0; // of all tasks: rows, and numbers of references
  std::vector<int> held, touching, driven; // rows of the scene
  std::vector<int> motors, rigid; // entries of v
  std::vector<int> limited; // motors that have a limit
  VectorXd torque; // that limit over the mass
  AccelerationLimits accelerations;
  MatrixXd cones; // of all contacts, with zeros where they turn
  std::vector<TurningCone> turning;
  double mass, regularisation;
  double rank, parallel; // tolerances: RANK, PARALLEL
  double kkt; // residual of an answer that counts
  double least; // |J|^2 of a J that is more than rounding
  // of a hierarchy: multipliers that keep a row active, what it may give then, and what is left of rows that are decided
  double strictly, slack, decided;
};
} // namespace condyn
