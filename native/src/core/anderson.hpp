// Anderson's acceleration of an iteration: the combination of its last points that would leave the least change.
//
//   x - sum_i w_i (x_i - x_{i-1}),    w = argmin |r - sum_i w_i (r_i - r_{i-1})|
//
// with r the changes of z. Until it remembers as many points as it may, the last one is taken as it is.
#pragma once
#include <Eigen/Dense>
#include <vector>

namespace condyn
{
class Anderson
{
  using VectorXd = Eigen::VectorXd;

public:
  explicit Anderson(int capacity) : capacity_(capacity) {}

  bool is_full() const { return int(points_.size()) == capacity_; }
  void forget() { points_.clear(); }

  void remember(const VectorXd & x, const VectorXd & z, const VectorXd & change)
  {
    if (!capacity_)
      return;
    if (is_full())
      points_.erase(points_.begin());
    points_.push_back({x, z, change});
  }

  /// Takes x and z to where the iteration seems to go; they are the last ones remembered.
  void accelerate(VectorXd & x, VectorXd & z) const
  {
    const int count = int(points_.size()) - 1;
    if (count < 1 || !is_full())
      return;
    Eigen::MatrixXd D(x.size(), count);
    for (int i = 0; i < count; ++i)
      D.col(i) = points_[count - i].change - points_[count - i - 1].change;
    const VectorXd w = D.colPivHouseholderQr().solve(points_[count].change);
    for (int i = 0; i < count; ++i)
    {
      x -= w[i] * (points_[count - i].x - points_[count - i - 1].x);
      z -= w[i] * (points_[count - i].z - points_[count - i - 1].z);
    }
  }

private:
  struct Point
  {
    VectorXd x, z, change;
  };

  int capacity_;
  std::vector<Point> points_; // the last one behind
};
} // namespace condyn
