#include "task_rows.hpp"
#include <algorithm>

namespace condyn
{
Matrix3d axes_of(const Constraint & contact, const Data & data)
{
  const SE3 body = data.oMi[contact.joint1] * contact.placement1;
  if (contact.kind != Kind::roll)
    return body.rotation();
  const Touch at(contact, body.actInv(contact.placement2).rotation(), Vector3d::Zero());
  Matrix3d axes;
  axes << at.axes[0].x, at.axes[1].x, at.axes[2].x;
  return body.rotation() * axes;
}

TaskRows::TaskRows(const Scene & scene, const TickSpec & spec)
: J(MatrixXd::Zero(spec.task_rows, scene.model.nv)), F(MatrixXd::Zero(spec.task_rows, spec.touching.size()))
, b(VectorXd::Zero(spec.task_rows)), scene_(scene), spec_(spec), place_(scene.rows, 0)
, three_(3, scene.model.nv)
{
  for (std::size_t i = 0; i < spec.touching.size(); ++i)
    place_[spec.touching[i]] = int(i);
  const Model & model = scene.model;
  for (const auto & task : spec.tasks)
  {
    auto & moved = moved_.emplace_back();
    if (task.kind <= TaskKind::pose)
      for (auto i : model.supports[task.at])
        for (int k = 0; i && k < model.nvs[i]; ++k)
          moved.push_back(model.idx_vs[i] + k);
    for (int row = 0; row < int(task.columns.size()); ++row)
      J(task.first + row, task.columns[row]) = 1.0;
  }
}

void TaskRows::at(TickTerms & terms, const double * numbers)
{
  Vector3d velocity, drift;
  for (const auto & task : spec_.tasks)
  {
    const double * x_r = numbers + task.reference;
    const Eigen::Map<const Vector3d> three(x_r); // of those that have three
    switch (task.kind)
    {
    case TaskKind::position:
    case TaskKind::orientation:
    case TaskKind::pose: of_frame(task, terms, x_r); break;
    case TaskKind::center_of_mass:
    {
      const Vector3d c = terms.center_of_mass(three_, velocity, drift);
      J.middleRows<3>(task.first) = three_;
      follow(task, three - c, velocity, drift, x_r);
      break;
    }
    case TaskKind::angular_momentum:
    {
      const Vector3d L = terms.angular_momentum(three_, drift);
      J.middleRows<3>(task.first) = three_;
      follow(task, three - L, Vector3d::Zero(), drift, x_r);
      break;
    }
    case TaskKind::joint:
      b[task.first] = x_r[2] + task.kp * (x_r[0] - terms.q[task.at])
        + task.kd * (x_r[1] - terms.v[task.columns[0]]);
      break;
    case TaskKind::posture:
    {
      const VectorXd left = terms.way_to(In(x_r, task.of_x));
      const double *v_r = x_r + task.of_x, *a_r = v_r + task.of_v;
      for (int row = 0; row < task.size; ++row)
      {
        const int k = task.columns[row];
        b[task.first + row] = a_r[k] + task.kp * left[k] + task.kd * (v_r[k] - terms.v[k]);
      }
      break;
    }
    case TaskKind::contact_force: of_force(task, terms.data, x_r); break;
    case TaskKind::capture_point:
    {
      const Vector3d c = terms.center_of_mass(three_, velocity, drift);
      J.middleRows<3>(task.first) = three_;
      of_capture_point(task, c, velocity, x_r);
      b.segment<3>(task.first) -= drift;
    }
    }
  }
}

void TaskRows::of_frame(const Task & task, const TickTerms & terms, const double * x_r)
{
  const Data & data = terms.data;
  const End end(data, task.at, task.placement);
  const Matrix3d & R = end.E.rotation();
  const bool turns = task.kind != TaskKind::position, moves = task.kind != TaskKind::orientation;
  const int about = task.first + (moves ? 3 : 0); // rows of the rotation
  for (int j : moved_[&task - spec_.tasks.data()])
  {
    const Vector3d w = data.J.col(j).tail<3>();
    if (moves)
      J.col(j).segment<3>(task.first) = data.J.col(j).head<3>() + w.cross(end.E.translation());
    if (turns)
      J.col(j).segment<3>(about) = w;
  }
  Vector6d left = Vector6d::Zero(), v, drift;
  v << R * end.v.linear(), R * end.v.angular();
  drift << R * end.classical(), R * end.a.angular();
  const int first = moves ? 0 : 3;
  if (task.kp != 0) // of a task without feedback there is no reference
  {
    const double * rotation = x_r + (moves ? 3 : 0);
    if (moves)
      left.head<3>() = Eigen::Map<const Vector3d>(x_r) - end.E.translation();
    if (turns)
      left.tail<3>() = pinocchio::log3(
        Matrix3d(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rotation) * R.transpose()));
  }
  follow(task, left.segment(first, task.size), v.segment(first, task.size), drift.segment(first, task.size), x_r);
}

void TaskRows::of_force(const Task & task, const Data & data, const double * x_r)
{
  const Constraint & k = scene_.constraints[task.at];
  const Matrix3d R = axes_of(k, data);
  for (int i = 0; i < k.size; ++i)
    if (k.selection[i] < 3)
      F.col(place_[k.first + i]).segment<3>(task.first) = R.col(k.selection[i]);
  b.segment<3>(task.first) = Eigen::Map<const Vector3d>(x_r);
}

/// c'' = omega^2 (c - p),  p = m + s (1 + k) (xi - m),  xi = c + c' / omega,  s <= 1, along the floor; the height as a
/// centre of mass with kp = k omega^2 and kd = (k + 1) omega.
void TaskRows::of_capture_point(
  const Task & task, const Vector3d & com, const Vector3d & com_velocity, const double * x_r)
{
  const Matrix3d & R = task.placement.rotation();
  const double k = task.kp, omega = task.kd, square = omega * omega;
  const Eigen::Map<const Vector3d> m(x_r);
  const Eigen::Map<const Eigen::Matrix2Xd> edges(x_r + 3, 2, (task.of_x - 3) / 2);
  const Vector3d c = task.placement.actInv(com), v = R.transpose() * com_velocity;
  Eigen::Vector2d ahead = (1 + k) * (c + v / omega - m).head<2>();
  ahead /= std::max(1.0, (edges.transpose() * ahead).maxCoeff());
  Vector3d wanted;
  wanted.head<2>() = square * ((c - m).head<2>() - ahead);
  wanted[2] = k * square * (m[2] - c[2]) - (k + 1) * omega * v[2];
  b.segment<3>(task.first) = R * wanted;
}

void TaskRows::follow(
  const Task & task, const VectorXd & left, const VectorXd & v, const VectorXd & drift, const double * x_r)
{
  const In v_r(x_r + task.of_x, task.of_v), a_r(x_r + task.of_x + task.of_v, task.of_v);
  b.segment(task.first, task.size) = a_r + task.kp * left + task.kd * (v_r - v) - drift;
}
} // namespace condyn
