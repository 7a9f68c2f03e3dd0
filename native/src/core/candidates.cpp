#include "candidates.hpp"
#include "want.hpp"
#include <map>

namespace condyn
{
Candidates::Candidates(
  const Model & model, const std::vector<ContactPoint> & touches, const std::vector<Pair> & pairs,
  const std::vector<Stop> & stops, const std::vector<Dry> & dry)
: touches(touches), pairs(pairs), stops(stops), dry(dry)
{
  for (const auto & t : touches)
    add_cone(model, t.joint, t.ground);
  for (const auto & pair : pairs)
  {
    const int first = cones();
    for (int k = 0; k < pair.places(); ++k)
      add_cone(model, pair.joint, pair.ground);
    if (pair.places() > 1)
      several.emplace_back(first, cones());
  }
  for (const auto & s : stops)
    want(0 <= s.at_q && s.at_q < model.nq && 0 <= s.at_v && s.at_v < model.nv, "coordinates of a stop");
  for (const auto & d : dry)
    want(0 <= d.at_v && d.at_v < model.nv, "coordinate of dry friction");
}

void Candidates::add_cone(const Model & model, int joint, int ground)
{
  want(0 <= std::min(joint, ground) && std::max(joint, ground) < model.njoints, "joints of a contact");
  std::map<int, double> columns;
  for (const auto & [side, sign] : {std::pair(joint, 1.0), std::pair(ground, -1.0)})
    for (auto j = side; j > 0; j = int(model.parents[j]))
      for (int k = 0; k < model.nvs[j]; ++k)
        columns[model.idx_vs[j] + k] += sign;
  sides_.emplace_back(joint, ground);
  moves_.emplace_back();
  for (const auto & [column, sign] : columns)
    if (sign != 0)
      moves_.back().emplace_back(column, sign);
}

double Candidates::friction(int cone) const
{
  if (cone < over_planes())
    return touches[cone].friction;
  int end = over_planes();
  for (const Pair & pair : pairs)
    if (cone < (end += pair.places()))
      return pair.friction;
  return 0.0;
}

Candidates::Place Candidates::place(const ContactPoint & t, const Data & data)
{
  const SE3 plane = t.ground ? data.oMi[t.ground] * t.plane : t.plane;
  const Vector3d p = t.joint ? data.oMi[t.joint].act(t.centre) : t.centre, n = plane.rotation().col(2);
  return {plane.rotation(), p - t.radius * n, n.dot(p - plane.translation()) - t.radius};
}

Candidates::Place Candidates::place(const Meeting & at)
{
  return {Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), at.normal).toRotationMatrix(), at.point, at.gap};
}

void Candidates::heights(const Data & data, VectorXd & gaps) const
{
  gaps.resize(over_planes());
  for (int i = 0; i < over_planes(); ++i)
    gaps[i] = place(touches[i], data).gap;
}

void Candidates::gaps(const Data & data, const VectorXd & q, VectorXd & gaps) const
{
  gaps.resize(with_gaps());
  each_place(data, [&](int i, const Place & at) { gaps[i] = at.gap; });
  for (std::size_t s = 0; s < stops.size(); ++s)
    gaps[cones() + s] = stops[s].sign * (q[stops[s].at_q] - stops[s].limit);
}

void Candidates::rows(const Data & data, MatrixXd & J) const
{
  J.setZero(rows(), data.J.cols());
  each_place(data, [&](int i, const Place & at) {
    Eigen::Matrix<double, 3, 6> twist;
    twist.leftCols<3>() = at.E.transpose();
    for (int d = 0; d < 3; ++d)
      twist.block<1, 3>(d, 3) = at.point.cross(at.E.col(d)).transpose();
    for (const auto & [column, sign] : moves_[i])
      J.block<3, 1>(3 * i, column).noalias() = sign * (twist * data.J.col(column));
  });
  int row = 3 * cones();
  for (const auto & s : stops)
    J(row++, s.at_v) = s.sign;
  for (const auto & d : dry)
    J(row++, d.at_v) = 1.0;
}

void Candidates::normal_row(
  int touch, const Data & data, Eigen::Ref<Eigen::RowVectorXd, 0, Eigen::InnerStride<>> J) const
{
  const Place at = place(touches[touch], data);
  Vector6d twist;
  twist << at.E.col(2), at.point.cross(at.E.col(2));
  J.setZero();
  for (const auto & [column, sign] : moves_[touch])
    J[column] = sign * twist.dot(data.J.col(column));
}

void Candidates::push(const Data & data, const VectorXd & lam, Forces & on_joint, VectorXd & torque) const
{
  each_place(data, [&](int i, const Place & at) {
    if (lam.segment<3>(3 * i).isZero(0)) // a place without a point may be nowhere
      return;
    const Vector3d f = at.E * lam.segment<3>(3 * i);
    const Force in_world(f, at.point.cross(f));
    const auto & [joint, ground] = sides_[i];
    if (joint)
      on_joint[joint] += data.oMi[joint].actInv(in_world);
    if (ground)
      on_joint[ground] -= data.oMi[ground].actInv(in_world);
  });
  int row = 3 * cones();
  for (const auto & s : stops)
    torque[s.at_v] += s.sign * lam[row++];
  for (const auto & d : dry)
    torque[d.at_v] += lam[row++];
}
} // namespace condyn
