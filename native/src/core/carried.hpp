// Which rows of the equations of motion a coordinate changes: those of what it carries, of what carries it, and of
// what constraints and contacts tie to these; and which rows of constraints, below them.
#pragma once
#include "pinocchio.hpp"
#include <algorithm>

namespace condyn
{
/// Where a matrix (nv, nv) may not be zero, or one (nv + rows, nv), column by column.
class Carried
{
public:
  explicit Carried(const Model & model, int rows = 0)
  : is_(model.nv, std::vector<char>(model.nv + rows, 0)), spans_(model.nv)
  {
    for (int j = 1; j < model.njoints; ++j)
    {
      std::vector<int> chain;
      for (auto i : model.supports[j])
        for (int k = 0; i && k < model.nvs[i]; ++k)
          chain.push_back(model.idx_vs[i] + k);
      tie(chain);
    }
  }

  /// Each of these coordinates changes the rows of all others of them.
  void tie(const std::vector<int> & columns)
  {
    for (int j : columns)
    {
      for (int i : columns)
        is_[j][i] = 1;
      find_spans(j);
    }
  }

  /// A coordinate changes some rows of constraints.
  void change(int j, int first, int size)
  {
    std::fill_n(is_[j].begin() + int(is_.size()) + first, size, 1);
    find_spans(j);
  }

  /// Adds P f to y: f has columns for each coordinate, once or more often.
  template<typename Y>
  void add_product(const MatrixXd & P, const MatrixXd & f, Y && y) const
  {
    const int n = int(spans_.size());
    for (int c = 0; c < int(f.cols()); ++c)
      for (const auto & [begin, size] : spans_[c % n])
        y.col(c).noalias() += P.middleCols(begin, size) * f.col(c).segment(begin, size);
  }

private:
  void find_spans(int j)
  {
    spans_[j].clear();
    for (int i = 0; i < int(is_[j].size()); ++i)
      if (is_[j][i] && (i == 0 || !is_[j][i - 1]))
        spans_[j].emplace_back(i, 1);
      else if (is_[j][i])
        ++spans_[j].back().second;
  }

  std::vector<std::vector<char>> is_;
  std::vector<std::vector<std::pair<int, int>>> spans_; // of rows: where each begins, and how many
};
} // namespace condyn
