// M = S^T S along the tree of the joints: Cholesky's factor from the leaves to the root, where branches do not fill.
//
//   S_ki = (M_ki - sum_r S_rk S_ri) / S_kk,    r from k + 1 to the last coordinate that k carries
//
// S_ki is zero unless i carries k (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.5). What ties branches
// makes the tree longer: it is then that of elimination (Liu, The role of elimination trees, 1990).
#pragma once
#include "pinocchio.hpp"
#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

namespace condyn
{
class TreeFactor
{
  MatrixXd S_;
  std::vector<int> carriers_, below_; // the coordinate before on the way to the root, and how many come behind

  /// Column k below its diagonal, as far as k carries.
  auto column(int k) const { return S_.col(k).segment(k + 1, below_[k]); }

public:
  /// `ties` are groups of coordinates, ascending, that M is full between beside those of each branch.
  explicit TreeFactor(const Model & model, const std::vector<std::vector<int>> & ties = {})
  : S_(MatrixXd::Zero(model.nv, model.nv)), carriers_(model.nv, -1), below_(model.nv, 0)
  {
    std::vector<std::set<int>> before(model.nv); // with which each one shares an entry, and those that elimination adds
    const auto tie = [&before](const std::vector<int> & columns) {
      for (std::size_t c = 1; c < columns.size(); ++c)
        before[columns[c]].insert(columns[c - 1]);
    };
    for (int j = 1; j < model.njoints; ++j)
    {
      const int parent = int(model.parents[j]);
      int carrier = parent ? model.idx_vs[parent] + model.nvs[parent] - 1 : -1;
      for (int k = model.idx_vs[j]; k < model.idx_vs[j] + model.nvs[j]; carrier = k++)
        if (carrier >= 0)
          tie({carrier, k});
    }
    for (const auto & columns : ties)
      tie(columns);
    for (int k = size() - 1; k >= 0; --k)
    {
      if (before[k].empty())
        continue;
      const int carrier = *before[k].rbegin();
      before[carrier].insert(before[k].begin(), std::prev(before[k].end()));
      carriers_[k] = carrier, below_[carrier] = std::max(below_[carrier], k + below_[k] - carrier);
    }
  }

  /// Of M with more on its diagonal; false where that is not positive definite.
  bool factorise(const MatrixXd & M, const VectorXd & more)
  {
    for (int k = size() - 1; k >= 0; --k)
      for (int i = k; i >= 0; i = carriers_[i])
      {
        const double left = M(k, i) - column(k).dot(S_.col(i).segment(k + 1, below_[k]));
        if (i < k)
          S_(k, i) = left / S_(k, k);
        else if (left + more[k] > 0)
          S_(k, k) = std::sqrt(left + more[k]);
        else
          return false;
      }
    return true;
  }

  int size() const { return int(S_.rows()); }
  /// S v.
  VectorXd operator*(const VectorXd & v) const { return S_.triangularView<Eigen::Lower>() * v; }

  /// S^-T x, in place.
  void whiten(VectorXd & x) const
  {
    for (int k = size() - 1; k >= 0; --k)
      x[k] = (x[k] - column(k).dot(x.segment(k + 1, below_[k]))) / S_(k, k);
  }
  /// S^-1 x, in place.
  void unwhiten(VectorXd & x) const
  {
    for (int k = 0; k < size(); ++k)
    {
      x[k] /= S_(k, k);
      x.segment(k + 1, below_[k]) -= x[k] * column(k);
    }
  }

  /// J S^-1, in place: each row is one that S^-T is applied to.
  void whiten_rows(MatrixXd & J) const
  {
    for (int k = size() - 1; k >= 0; --k)
    {
      if (J.col(k).isZero(0.0))
        continue;
      J.col(k) /= S_(k, k);
      for (int i = carriers_[k]; i >= 0; i = carriers_[i])
        J.col(i) -= S_(k, i) * J.col(k);
    }
  }
  /// Y S^-T, in place: each row is one that S^-1 is applied to.
  void unwhiten_rows(MatrixXd & Y) const
  {
    for (int k = 0; k < size(); ++k)
    {
      for (int i = carriers_[k]; i >= 0; i = carriers_[i])
        Y.col(k) -= S_(k, i) * Y.col(i);
      Y.col(k) /= S_(k, k);
    }
  }

  /// M^-1 = S^-1 S^-T, which is full.
  void invert(MatrixXd & inverse) const
  {
    inverse.setZero(size(), size());
    VectorXd of_k(size());
    for (int k = 0; k < size(); ++k)
    {
      const int end = k + 1 + below_[k];
      of_k.segment(k, end - k).setZero();
      of_k[k] = 1.0;
      for (int i = k; i < end; ++i)
      {
        of_k[i] /= S_(i, i);
        of_k.segment(i + 1, below_[i]) -= of_k[i] * column(i);
      }
      for (int i = k; i < end; ++i)
        inverse.col(i).segment(i, end - i) += of_k[i] * of_k.segment(i, end - i);
    }
    for (int i = 1; i < size(); ++i)
      inverse.col(i).head(i) = inverse.row(i).head(i).transpose();
  }
};
} // namespace condyn
