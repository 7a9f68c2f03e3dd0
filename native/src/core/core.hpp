// Core: a scene and its solver, and the memory of the threads that work on it.
#pragma once
#include "answers.hpp"
#include "derivatives.hpp"
#include "motion.hpp"
#include "proof.hpp"
#include "scene_arrays.hpp"

namespace condyn
{
/// What one thread has to itself.
struct Worker
{
  std::unique_ptr<Solver> solver;
  Proof proof;
  std::unique_ptr<Derivatives> derivatives; // made when they are first asked for
  std::unique_ptr<Mover> mover;
  std::unique_ptr<Loads> loads; // of the batch
  VectorXd q, v, tau;

  explicit Worker(const Scene & scene) : solver(solver_of(scene)), proof(scene) {}
};

/// States, a row each, and the forces from outside at each: how they act, and six numbers of each of them.
struct States
{
  Table q, v, tau;
  IntegerTable pushes; // joint, whether in the axes of the world
  Table placements;
  Table wrenches;
};

/// Answers, a row a state.
struct Answers
{
  Array<double, 2> a, lam, sizes; // sizes: `Sizes`, whether the rows were exact, and what is left of pivots
  Array<int, 1> iterations;
  Array<double, 1> times; // [s]
  Array<double, 2> loads; // sizes of what the forces from outside do to the joints
};

/// Motions, a row each: their samples, with a and lam or without rows for them.
struct Motions
{
  Array<double, 2> t;
  Array<double, 3> q, v, a, lam, measures;
  Array<int, 1> done; // 1, or 0 for a motion that was given up
  Array<double, 1> times; // [s]
};

class Core
{
public:
  explicit Core(const SceneArrays & arrays);
  Core(const Core &) = delete; // its workers hold references to its scene

  const Scene & scene() const { return scene_; }

  void solve(const States & states, const Answers & answers, int threads);

  /// One state, in the calling thread: returns its sizes, with iterations and seconds behind them.
  Eigen::Matrix<double, 11, 1> solve_one(
    const List & q, const List & v, const List & tau, const Array<double, 1> & a, const Array<double, 1> & lam);

  /// da/dq, da/dv, da/dtau, dlam/dq, dlam/dv, dlam/dtau as well, each with a matrix a state.
  void differentiate(
    const States & states, const Answers & answers, const std::vector<Array<double, 3>> & blocks, int threads);

  void simulate(const Table & Q, const Table & V, const Table & TAU, const MotionPlan & plan,
    const Motions & motions, int threads);

private:
  void check(const States & states, const Answers & answers) const;
  std::vector<Push> pushes(const States & states) const;
  /// The memory of so many threads; made when it is first asked for.
  void prepare(int threads);
  /// Readies the memory of so many threads for some forces.
  void load(const States & states, int threads);
  /// Answers one state; returns its a, in the memory of the worker.
  const VectorXd & answer(Worker & own, std::size_t i, const States & states, const Answers & answers) const;

  Scene scene_;
  std::vector<std::unique_ptr<Worker>> workers_;
};
} // namespace condyn
