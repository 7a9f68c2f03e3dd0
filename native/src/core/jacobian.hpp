// J: how body 1 slips past body 2 by each coordinate, constraint by constraint.
#pragma once
#include "rolling.hpp"
#include "scene.hpp"

namespace condyn
{
/// The coordinates that move a side of a constraint or of a spring, and which.
struct Moved
{
  std::vector<int> columns;
  std::vector<char> one, two;

  Moved(const Model & model, const Constraint & k)
  {
    if (k.kind != Kind::coupling)
      *this = Moved(model, k.joint1, k.joint2);
  }

  Moved(const Model & model, int joint1, int joint2)
  {
    const auto by1 = above(model, joint1), by2 = above(model, joint2);
    for (int j = 0; j < model.nv; ++j)
      if (by1[j] || by2[j])
        columns.push_back(j), one.push_back(by1[j]), two.push_back(by2[j]);
  }

  /// Whether a column may have entries in rows of its own constraint: what carries both sides moves them as one,
  /// which rows of balls see where they are apart.
  bool slips(std::size_t column, const Constraint & k) const
  {
    return k.kind == Kind::ball || one[column] != two[column];
  }

private:
  static std::vector<char> above(const Model & model, int joint)
  {
    std::vector<char> moved(model.nv, 0);
    for (auto i : model.supports[joint])
      for (int k = 0; i && k < model.nvs[i]; ++k)
        moved[model.idx_vs[i] + k] = 1;
    return moved;
  }
};

/// The row of a coupling; of a joint that is held alone, a and b are one.
template<typename Row>
void write_coupling(const Constraint & k, Row && row)
{
  row[k.v_a] += 1.0;
  row[k.v_b] -= k.length;
}

/// The slip of a constraint by the motions of its two sides.
class Slip
{
public:
  Slip(const Constraint & k, const Data & data)
  : k_(k), E1_(data.oMi[k.joint1] * k.placement1), E2_(data.oMi[k.joint2] * k.placement2)
  , between_(E1_.actInv(E2_))
  {
    if (k.kind == Kind::rod)
      along_ = between_.translation() / std::max(between_.translation().norm(), 1e-300);
    if (k.is_cross())
      along_ = Cross(k, between_.rotation()).w;
    if (k.kind == Kind::roll)
    {
      const Touch at(k, between_.rotation(), Vector3d::Zero());
      point_ = at.r.x;
      axes_ << at.axes[0].x, at.axes[1].x, at.axes[2].x;
    }
  }

  /// Of motions in the world, such as the columns of its Jacobians.
  Vector6d operator()(const Motion & in_world1, const Motion & in_world2) const
  {
    const Motion one = E1_.actInv(in_world1), two = E2_.actInv(in_world2);
    const Matrix3d & R = between_.rotation();
    Vector6d slip = Vector6d::Zero();
    switch (k_.kind)
    {
    case Kind::held: return one.toVector();
    case Kind::weld: return (one - between_.act(two)).toVector();
    case Kind::ball: slip.head<3>() = one.linear() - R * two.linear(); break;
    case Kind::cut:
      slip.head<3>() = one.linear() + one.angular().cross(between_.translation()) - R * two.linear();
      slip.tail<3>() = one.angular() - R * two.angular();
      if (k_.is_cross())
        slip[3] = along_.dot(slip.tail<3>());
      break;
    case Kind::rod: slip[0] = along_.dot(one.linear() - R * two.linear()); break;
    case Kind::roll: slip.head<3>() = axes_.transpose() * (one.linear() + one.angular().cross(point_)); break;
    case Kind::coupling: break; // between coordinates
    }
    return slip;
  }

private:
  const Constraint & k_;
  SE3 E1_, E2_, between_;
  Vector3d along_, point_;
  Matrix3d axes_;
};

/// Writes J (m, nv), after joint Jacobians.
inline void write_jacobian(const Scene & scene, const Data & data, const std::vector<Moved> & moved, MatrixXd & J)
{
  J.setZero(scene.rows, scene.model.nv);
  const Motion still(Motion::Zero());
  for (std::size_t i = 0; i < scene.constraints.size(); ++i)
  {
    const Constraint & k = scene.constraints[i];
    if (k.kind == Kind::coupling)
    {
      write_coupling(k, J.row(k.first));
      continue;
    }
    const Slip slip(k, data);
    for (std::size_t c = 0; c < moved[i].columns.size(); ++c)
    {
      const int j = moved[i].columns[c];
      const Motion column(data.J.col(j).head<3>(), data.J.col(j).tail<3>());
      const Vector6d by = slip(moved[i].one[c] ? column : still, moved[i].two[c] ? column : still);
      for (int row = 0; row < k.size; ++row)
        J(k.first + row, j) = k.sign * by[k.component(row)];
    }
  }
}
} // namespace condyn
