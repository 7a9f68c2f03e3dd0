// Solver: how a thread answers states of a scene.
#pragma once
#include "redundancy.hpp"
#include "springs.hpp"

namespace condyn
{
/// One thread's memory of a scene and its method.
class Solver
{
public:
  explicit Solver(const Scene & scene) : scene(scene), model(scene.model), data(model) {}
  Solver(const Solver &) = delete; // it refers to its scene
  virtual ~Solver() = default;

  /// a, which is not finite where Python has to look.
  virtual const VectorXd & acceleration(const VectorXd & q, const VectorXd & v, const VectorXd & tau) = 0;
  /// lam of the last acceleration, the smallest.
  virtual VectorXd scene_forces() = 0;
  /// What is left of the pivots of M that are watched: the least of their shares of the nominal ones.
  virtual double pivots_left() = 0;

  /// Told where a motion begins, after contacts without an anchor have got one. `rank` is that of all rows
  /// at configurations that are not singular by accident.
  virtual void begin(int rank) = 0;
  /// Whether `close` reads what an acceleration at the same state has left.
  virtual bool closes_by_its_factor() const = 0;
  /// Finds the least moves dq and dv, in the metric of M, that close gaps and stop slips.
  virtual bool close(const VectorXd & q, const VectorXd & v, VectorXd & dq, VectorXd & dv) = 0;

  const Scene & scene;
  Model model; // its own: integrators change the armature
  SpringInertia springs; // on top of M, by integrators too
  Data data;
  int iterations = 0;
  const Redundancy * left = nullptr; // what the last answer leaves out of the rows, if that is more than nothing

protected:
  /// Rows that are zero at every configuration carry nothing.
  VectorXd without_idle(VectorXd lam) const
  {
    for (int i : scene.precision.idle)
      lam[i] = 0.0;
    return lam;
  }

  double share_of_pivots(const Eigen::Ref<const VectorXd> & pivots) const
  {
    double left = 1.0;
    for (std::size_t i = 0; i < scene.watched.size(); ++i)
      left = std::min(left, pivots[scene.watched[i]] / scene.nominal_pivots[i]);
    return left;
  }
};
} // namespace condyn
