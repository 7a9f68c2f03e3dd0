// Core: a scene and its solver, and the memory of the threads that work on it.
#pragma once
#include "arrays.hpp"
#include "proof.hpp"
#include "proximal.hpp"
#include <memory>

namespace condyn
{
/// What one thread has to itself.
struct Worker
{
  Proximal solver;
  Proof proof;
  VectorXd q, v, tau;

  explicit Worker(const Scene & scene) : solver(scene), proof(scene) {}
};

class Core
{
public:
  /// `condyn_pin/dynamics/compiled/arrays.py` says what each is.
  Core(
    const std::vector<std::string> & kinds, const Integers & parents, const Table & joints, const List & gravity,
    const List & armature, const IntegerTable & constraints, const Table & of_constraints,
    const IntegerTable & plain, const Table & of_plain, const Table & to_scene, const List & drift,
    const List & weights, double open_squared, const List & proximal);
  Core(const Core &) = delete; // its workers hold references to its scene

  void solve(
    const Table & Q, const Table & V, const Table & TAU, const Array<double, 2> & a, const Array<double, 2> & lam,
    const Array<double, 2> & sizes, const Array<int, 1> & iterations, const Array<double, 1> & times, int threads);

private:
  void check(const Table & Q, const Table & V, const Table & TAU) const;
  /// The memory of so many threads; made when it is first asked for.
  void prepare(int threads);

  Scene scene_;
  std::vector<std::unique_ptr<Worker>> workers_;
};
} // namespace condyn
