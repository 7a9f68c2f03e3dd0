// Core: a scene and its solver, and the memory of the threads that work on it.
#pragma once
#include "answers.hpp"
#include "derivatives.hpp"
#include "motion.hpp"
#include "proof.hpp"
#include "scene_fields.hpp"

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
  VectorXd q, v, tau, lam;

  explicit Worker(const Scene & scene) : solver(solver_of(scene)), proof(scene) {}
};

/// States, a row each.
struct States
{
  Table q, v, tau;
};

/// And the forces from outside at each: how they act, and six numbers of each of them.
struct LoadedStates : States
{
  std::vector<Push> pushes;
  Table wrenches;
};

/// Answers, a row a state.
struct Answers
{
  Array<double, 2> a, lam, residuals; // residuals: `Residuals`
  Array<int, 1> iterations, clear; // clear: 1, or 0 for a state that is left to Python
  Array<double, 1> times; // [s]
};

void fill(const Fields & x, States & to);
void fill(const Fields & x, LoadedStates & to);
void fill(const Fields & x, Answers & to);

/// As in Python: the largest of each, and the bound on the error of a.
struct Residuals
{
  double dynamics, constraint, violation, velocity, bound;
};

/// One answer, with its a and lam in the memory of a worker.
struct Answer
{
  const VectorXd & a;
  const VectorXd & lam;
  Residuals residuals;
  bool clear; // ok without a doubt
  int iterations;
  double seconds;
};

/// Motions, a row each: their samples, with a and lam or without rows for them.
struct Motions
{
  Array<double, 2> t;
  Array<double, 3> q, v, a, lam, measures;
  Array<int, 1> done; // 1, or 0 for a motion that was given up
  Array<double, 1> times; // [s]
};

void fill(const Fields & x, Motions & to);
void fill(const Fields & x, MotionPlan & to);

class Core
{
public:
  explicit Core(Scene scene) : scene_(std::move(scene)) {}
  Core(const Core &) = delete; // its workers hold references to its scene

  const Scene & scene() const { return scene_; }

  void solve(const LoadedStates & states, const Answers & answers, double accuracy, int threads);

  /// Where an answer has its parts in the numbers of one state.
  nb::dict parts() const;
  /// One state, in the calling thread.
  Answer solve_one(const Numbers & q, const Numbers & v, const Numbers & tau, double accuracy, const Numbers & out);

  /// da/dq, da/dv, da/dtau, dlam/dq, dlam/dv, dlam/dtau as well, each with a matrix a state.
  void differentiate(const LoadedStates & states, const Answers & answers,
    const std::vector<Array<double, 3>> & blocks, double accuracy, int threads);

  /// The same of one state; whether it is ok without a doubt. The blocks are those of a and lam by q, by v and by tau
  /// (3, nv + rows, nv).
  bool differentiate_one(const Numbers & q, const Numbers & v, const Numbers & tau, double accuracy,
    const Numbers & out, const Numbers & blocks);

  void simulate(const States & states, const MotionPlan & plan, const Motions & motions, int threads);

private:
  void check(const LoadedStates & states, const Answers & answers) const;
  void prepare(int threads);
  /// Readies the memory of so many threads for some forces.
  void load(const std::vector<Push> & found, int threads);
  /// The first worker, which holds the state that it is to answer.
  Worker & hold(const Numbers & q, const Numbers & v, const Numbers & tau, const Numbers & out);
  /// Answers the state that a worker holds, without forces, into `out`.
  Answer answer_one(Worker & own, double accuracy, const Numbers & out) const;
  /// Answers the state that a worker holds, under its forces, six numbers each.
  Answer answer(Worker & own, const double * forces, double accuracy) const;
  Answer answer_row(
    Worker & own, std::size_t i, const LoadedStates & states, const Answers & answers, double accuracy) const;
  /// Differentiates what a worker has answered; false where there is a doubt.
  bool differentiate(Worker & own, const Answer & found, double * const out[6]) const;

  Scene scene_;
  std::vector<std::unique_ptr<Worker>> workers_;
};
} // namespace condyn
