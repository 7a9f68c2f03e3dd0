// One control tick: terms, program, answer and its proof.
#pragma once
#include "cascade.hpp"
#include "proof.hpp"
#include "tick_program.hpp"

namespace condyn
{
/// What an answer is judged by: `ControlResiduals`, and what they are compared with.
struct TickSizes
{
  double kkt, dynamics, constraints, a, torque, unreached;
  int changes; // of the active sets
  int answered; // levels
  double seconds; // of the program alone
};

class Tick
{
public:
  Tick(Scene scene, TickSpec spec);
  Tick(const Tick &) = delete; // its parts hold references to its scene

  /// Infinite sizes where Python has to look. `numbers` are the references of all tasks, and then those of rows that
  /// are driven. `sides` of each level are those to begin from, and then those of the answer.
  TickSizes operator()(
    const VectorXd & q, const VectorXd & v, const VectorXd & passive, const double * numbers,
    std::vector<Sides> & sides);

  const Scene & scene() const { return scene_; }
  const TickSpec & spec() const { return spec_; }

  const VectorXd & v() const { return program_.terms().v; } // without the swing of joints that are taken for rigid

  VectorXd a, tau, lam, rigid, errors; // of the last answer

private:
  /// Takes rows that are driven to where they are to be at the time of a tick: s, s' and s'' of each.
  void drive(const double * along);

  Scene scene_;
  const TickSpec spec_;
  TickProgram program_;
  Cascade cascade_;
  Proof proof_;
};
} // namespace condyn
