// How a move along a velocity changes with what it is given, joint by joint; tangent columns.
//
//   p+ = p + R x, R+ = R exp(y):    dp+ = E^T (dp - x x dtheta + dx),   dtheta+ = E^T dtheta + Jr dy
//   u+ = exp(-dt w) u:              du+ = E (du + dt u x Jr(-dt w) dw)
//
// with x and y the two halves of the move of a body that floats, and E the rotation that belongs to it. Joints
// with one coordinate go on by their move. `condyn_pin/gradients/routes/partials.py` has the same.
#pragma once
#include "pinocchio.hpp"
#include <cmath>

namespace condyn
{
/// A matrix that is the identity, or zero, but for square blocks on its diagonal.
struct Blocks
{
  using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6>;
  std::vector<std::pair<int, Small>> blocks; // where each begins

  void add(int at, const Small & block) { blocks.emplace_back(at, block); }
  /// Multiplies rows by it, from the left; it is the identity elsewhere.
  void premultiply(Eigen::Ref<MatrixXd> rows) const
  {
    for (const auto & [at, block] : blocks)
      if (block.rows() == 6)
        turn_rows<6>(at, block, rows);
      else
        turn_rows<3>(at, block, rows);
  }
  /// Multiplies columns by it, from the right; it is the identity elsewhere.
  void postmultiply(Eigen::Ref<MatrixXd> columns) const
  {
    for (const auto & [at, block] : blocks)
      columns.middleCols(at, block.rows()) = (columns.middleCols(at, block.rows()) * block).eval();
  }
  /// Adds scale x D to y; it is zero elsewhere.
  void add_product(const MatrixXd & x, double scale, Eigen::Ref<MatrixXd> y) const
  {
    for (const auto & [at, block] : blocks)
      y.middleCols(at, block.rows()).noalias() += x.middleCols(at, block.rows()) * (scale * block);
  }
  /// Adds it to y; it is the identity elsewhere.
  void add_to(Eigen::Ref<MatrixXd> y) const
  {
    y.diagonal().array() += 1.0;
    for (const auto & [at, block] : blocks)
    {
      y.diagonal().segment(at, block.rows()).array() -= 1.0;
      y.block(at, at, block.rows(), block.rows()) += block;
    }
  }

private:
  template<int size>
  static void turn_rows(int at, const Small & block, Eigen::Ref<MatrixXd> rows)
  {
    const Eigen::Matrix<double, size, size> turn = block;
    for (Eigen::Index c = 0; c < rows.cols(); ++c)
      rows.col(c).segment<size>(at) = (turn * rows.col(c).segment<size>(at)).eval();
  }
};

class MovedPartials
{
public:
  explicit MovedPartials(const Model & model)
  {
    for (int j = 1; j < model.njoints; ++j)
      if (model.nvs[j] > 1)
        joints_.emplace_back(model.idx_vs[j], model.nvs[j]);
  }

  /// The end of a move x by its start.
  Blocks by_start(const VectorXd & x) const
  {
    Blocks found;
    for (const auto & [i, size] : joints_)
    {
      const Matrix3d turn = pinocchio::exp3(Vector3d(-x.segment<3>(i + size - 3)));
      Blocks::Small block = Blocks::Small::Zero(size, size);
      block.bottomRightCorner<3, 3>() = turn;
      if (size == 6)
      {
        block.topLeftCorner<3, 3>() = turn;
        block.topRightCorner<3, 3>() = -turn * pinocchio::skew(Vector3d(x.segment<3>(i)));
      }
      found.add(i, block);
    }
    return found;
  }

  /// The end of a move x by the move.
  Blocks by_move(const VectorXd & x) const
  {
    Blocks found;
    for (const auto & [i, size] : joints_)
    {
      const Vector3d angle = x.segment<3>(i + size - 3);
      Matrix3d Jr;
      pinocchio::Jexp3(angle, Jr);
      Blocks::Small block = Blocks::Small::Zero(size, size);
      block.bottomRightCorner<3, 3>() = Jr;
      if (size == 6)
        block.topLeftCorner<3, 3>() = pinocchio::exp3(Vector3d(-angle));
      found.add(i, block);
    }
    return found;
  }

  /// v in the axes after dt, by v.
  Blocks turned(const VectorXd & v, double dt) const
  {
    Blocks found;
    for (const auto & [i, size] : joints_)
    {
      if (size != 6)
        continue;
      const Vector3d u = v.segment<3>(i), angle = -dt * v.segment<3>(i + 3);
      const Matrix3d turn = pinocchio::exp3(angle);
      Matrix3d Jr;
      pinocchio::Jexp3(angle, Jr);
      Blocks::Small block = Blocks::Small::Identity(6, 6);
      block.topLeftCorner<3, 3>() = turn;
      block.topRightCorner<3, 3>() = dt * turn * pinocchio::skew(u) * Jr;
      found.add(i, block);
    }
    return found;
  }

  /// w x u of bodies, by v; zero elsewhere.
  Blocks turning(const VectorXd & v) const
  {
    Blocks found;
    for (const auto & [i, size] : joints_)
    {
      if (size != 6)
        continue;
      Blocks::Small block = Blocks::Small::Zero(6, 6);
      block.topLeftCorner<3, 3>() = pinocchio::skew(Vector3d(v.segment<3>(i + 3)));
      block.topRightCorner<3, 3>() = -pinocchio::skew(Vector3d(v.segment<3>(i)));
      found.add(i, block);
    }
    return found;
  }

private:
  std::vector<std::pair<int, int>> joints_; // where v has those with several coordinates, and how many
};
} // namespace condyn
