#include "springs.hpp"
#include <algorithm>

namespace condyn
{
namespace
{
constexpr double slack = 1e-12; // as `_SLACK`: a direction so much less stiff than another is left out

Motion of_column(const Data & data, int j) { return Motion(data.J.col(j).head<3>(), data.J.col(j).tail<3>()); }

Vector3d at_point(const Motion & in_world, const Vector3d & point)
{
  return in_world.linear() + in_world.angular().cross(point);
}
} // namespace

std::vector<std::vector<int>> ties(const Scene & scene)
{
  std::vector<std::vector<int>> found;
  for (const SpringDamper & spring : scene.passive.between)
    found.push_back(Moved(scene.model, spring.joint_b, spring.joint_a).columns);
  return found;
}

Springs::Springs(const Scene & scene) : model_(scene.model), springs_(scene.passive.between), joint_of_(model_.nv)
{
  for (const SpringDamper & spring : springs_)
    moved_.emplace_back(model_, spring.joint_b, spring.joint_a);
  for (int i = 1; i < model_.njoints; ++i)
    std::fill_n(joint_of_.begin() + model_.idx_vs[i], model_.nvs[i], i);
}

void Springs::at(const Data & data)
{
  lines_.clear();
  J_.setZero(3 * springs_.size(), model_.nv);
  for (std::size_t s = 0; s < springs_.size(); ++s)
  {
    const Line & line = lines_.emplace_back(springs_[s], data);
    const Moved & moved = moved_[s];
    for (std::size_t c = 0; c < moved.columns.size(); ++c)
    {
      const Motion column = of_column(data, moved.columns[c]);
      auto J = J_.block<3, 1>(3 * s, moved.columns[c]);
      if (moved.one[c])
        J += at_point(column, line.at_b);
      if (moved.two[c])
        J -= at_point(column, line.at_a);
    }
  }
}

void Springs::pull(const VectorXd & v, double dt, VectorXd & tau) const
{
  for (std::size_t s = 0; s < springs_.size(); ++s)
  {
    const SpringDamper & its = springs_[s];
    const Line & line = lines_[s];
    const auto J = J_.middleRows<3>(3 * s);
    const Vector3d rate = J * v, along = line.n * line.n.dot(rate);
    Vector3d force = its.stiffness * (line.length - its.rest) * line.n + its.damping * along;
    force += dt * (its.stiffness * along + line.across(its) * (rate - along));
    tau.noalias() -= J.transpose() * force;
  }
}

SpringInertia Springs::inertia(double dt) const
{
  SpringInertia found{MatrixXd(3 * springs_.size(), model_.nv), VectorXd(3 * springs_.size())};
  int rows = 0;
  for (std::size_t s = 0; s < springs_.size(); ++s)
  {
    const SpringDamper & its = springs_[s];
    const Line & line = lines_[s];
    const double across = dt * dt * line.across(its);
    Vector3d weights(dt * its.damping + dt * dt * its.stiffness, across, across);
    Matrix3d axes = Matrix3d::Identity();
    if (line.coincide())
      weights[0] = across;
    else
      axes.col(0) = line.n, axes.col(1) = line.n.unitOrthogonal(), axes.col(2) = line.n.cross(axes.col(1));
    for (int i = 0; i < 3; ++i)
      if (weights[i] > slack * weights.maxCoeff())
      {
        found.U.row(rows).noalias() = axes.col(i).transpose() * J_.middleRows<3>(3 * s);
        found.w[rows++] = weights[i];
      }
  }
  found.U.conservativeResize(rows, Eigen::NoChange), found.w.conservativeResize(rows);
  return found;
}

/// J of r turns with q: by J^T g of a force g that stays (nv, nv), and by J w of a velocity w that stays (3, nv). A
/// coordinate turns what it carries, and moves the end past the axes of what carries it.
void Springs::turn(
  std::size_t s, const Data & data, const Vector3d & g, const VectorXd & w, MatrixXd & of_force,
  Eigen::Matrix3Xd & of_rate) const
{
  const Moved & moved = moved_[s];
  of_force.setZero(model_.nv, model_.nv), of_rate.setZero(3, model_.nv);
  const auto add = [&](const std::vector<char> & moves, const Vector3d & point, double sign) {
    for (std::size_t c = 0; c < moved.columns.size(); ++c)
      for (std::size_t b = 0; b < moved.columns.size(); ++b)
      {
        if (!moves[c] || !moves[b])
          continue;
        const int i = moved.columns[c], j = moved.columns[b];
        const bool carries = joint_of_[i] <= joint_of_[j];
        const Motion first = of_column(data, carries ? i : j), second = of_column(data, carries ? j : i);
        const Vector3d turned = sign * first.angular().cross(at_point(second, point));
        of_force(j, i) += g.dot(turned);
        of_rate.col(i) += w[j] * turned;
      }
  };
  add(moved.one, lines_[s].at_b, 1.0);
  add(moved.two, lines_[s].at_a, -1.0);
}

//   dt tau(q, v) - (dt D + dt^2 K) (v+ - v) = -dt J^T g,    g = k (l - l0) n + (D3 + dt K3) J v+
bool Springs::add_slopes(const VectorXd & v1, double dt, const Data & data, Eigen::Ref<MatrixXd> f) const
{
  MatrixXd of_force;
  Eigen::Matrix3Xd of_rate;
  for (std::size_t s = 0; s < springs_.size(); ++s)
  {
    const SpringDamper & its = springs_[s];
    const Line & line = lines_[s];
    if (line.coincide())
      return false;
    const auto J = J_.middleRows<3>(3 * s);
    const Vector3d & n = line.n;
    const Vector3d rate = J * v1;
    const double l = line.length, along = n.dot(rate), across = line.across(its);
    const double k_along = its.damping + dt * (its.stiffness - across);
    const double pulls = its.stiffness * (l - its.rest) + k_along * along;
    turn(s, data, pulls * n + dt * across * rate, v1, of_force, of_rate);
    for (int i : moved_[s].columns)
    {
      const Vector3d dr = J.col(i), d_rate = of_rate.col(i);
      const double dl = n.dot(dr), d_across = across > 0 ? its.stiffness * its.rest / (l * l) * dl : 0.0;
      const Vector3d dn = (dr - dl * n) / l;
      const double d_along = n.dot(d_rate) + rate.dot(dn);
      const double d_pulls = its.stiffness * dl + k_along * d_along - dt * d_across * along;
      const Vector3d dg = d_pulls * n + pulls * dn + dt * (d_across * rate + across * d_rate);
      f.col(i) -= dt * (of_force.col(i) + J.transpose() * dg);
    }
  }
  return true;
}
} // namespace condyn
