// Contacts: steps and motions of a scene whose contacts open, stick and slide, by some threads.
#pragma once
#include "contact_motion.hpp"
#include "core.hpp"
#include "step_derivatives.hpp"

namespace condyn
{
/// Steps, a row each.
struct Steps
{
  Array<double, 2> q, v, lam, errors; // lam: impulses of constraints, then of all candidates
  Array<int, 2> modes;
  Array<int, 1> done; // 1, or 0 for a step that is left to Python
};

/// Derivatives of steps, a row each, by q, v, tau and the friction of all cones; columns behind them stay.
struct Slopes
{
  Array<double, 3> dq, dv;
  Array<double, 1> margins;
  Array<int, 2> modes; // as derivatives read them
};

/// Motions on their way, a row each: steps taken, or -1 for what is not to go on; the state, and the
/// work of contacts and drives so far.
struct Ways
{
  Array<int, 1> step;
  Array<double, 2> q, v, work;
  Table tau;
};

class Contacts
{
public:
  /// `condyn_pin/dynamics/compiled.py` says what each is.
  Contacts(const Core & core, const Fields & x);
  Contacts(const Contacts &) = delete; // its workers hold references to its candidates

  void step(const States & states, const StepPlan & plan, const Steps & steps, int threads);
  /// The same with derivatives; a step without them is left to Python.
  void differentiate(
    const States & states, const StepPlan & plan, const Readings & readings, const Steps & steps,
    const Slopes & slopes, int threads);
  /// Takes motions that are not done as far as it can.
  void simulate(
    const Ways & ways, const StepPlan & plan, const MotionEnds & ends, const ContactMotions & motions, int threads);

  /// The plan of a step, and paths through so many.
  StepPlan plan(const Fields & x, int steps) const;

private:
  void prepare(int threads);
  void check(const States & states, const Steps & steps) const;
  bool step(ContactSteps & own, std::size_t i, const States & states, const StepPlan & plan, const Steps & steps) const;

  const Scene & scene_;
  Candidates candidates_;
  int rank_;
  std::vector<std::unique_ptr<ContactSteps>> workers_;
  std::vector<std::unique_ptr<StepDerivatives>> derivatives_; // of the workers
};

/// What Python sees.
void add_contacts(nb::module_ & m);
} // namespace condyn
