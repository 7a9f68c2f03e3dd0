#include "contact_motion.hpp"

namespace condyn
{
namespace
{
/// Where one motion writes its samples.
class Written
{
public:
  Written(const ContactMotions & to, std::size_t motion, ContactSteps & steps, double dt)
  : to_(to), i_(motion), steps_(steps), dt_(dt)
  {}

  void add(std::size_t row, const Way & way)
  {
    const std::size_t at = i_ * to_.t.shape(1) + row;
    to_.t.data()[at] = way.step * dt_;
    put(to_.q, row, way.q), put(to_.v, row, way.v), put(to_.work, row, way.work);
    if (to_.a.shape(1))
    {
      put(to_.a, row, steps_.a), put(to_.lam, row, steps_.impulses() / dt_);
      VectorXd contact(to_.contact.shape(2)); // the last one is the work of drives, where there are any
      contact[contact.size() - 1] = way.work[3];
      contact.head(4 + steps_.candidates.count()) << steps_.natural, way.work.head<3>(), steps_.modes().cast<double>();
      put(to_.contact, row, contact);
    }
    steps_.at(way.step);
    steps_.measure(way.q, way.v, to_.measures.data() + measured * at);
  }

private:
  void put(const Array<double, 3> & to, std::size_t row, const VectorXd & x)
  {
    Out(to.data() + (i_ * to.shape(1) + row) * to.shape(2), x.size()) = x;
  }

  const ContactMotions & to_;
  std::size_t i_;
  ContactSteps & steps_;
  double dt_;
};
} // namespace

bool run_motion(
  ContactSteps & own, Way & way, const MotionEnds & ends, double dt, const ContactMotions & to, std::size_t i,
  const std::atomic<bool> & stop)
{
  Written samples(to, i, own, dt);
  const auto cannot_go_on = [&] {
    way.step = -1;
    return false;
  };
  bool known = false; // whether the step from here has been taken
  if (way.step == 0)
  {
    own.at(0);
    own.anchor(way.q);
    if (!own.fits(way.q, way.v, ends.closed) || own.turns_too_far(way.v))
      return cannot_go_on();
    if (!own.attempt(way.q, way.v, 0))
      return false;
    samples.add(0, way);
    known = true;
  }
  while (way.step < ends.steps)
  {
    if (own.turns_too_far(way.v))
      return cannot_go_on();
    if (stop || (!known && !own.attempt(way.q, way.v, way.step)))
      return false;
    known = false;
    if (own.turns_too_far(own.v))
      return cannot_go_on();
    way.q = own.q, way.v = own.v, way.work += own.work, ++way.step;
    if (way.step % ends.every == 0)
      samples.add(way.step / ends.every, way);
  }
  if (ends.steps % ends.every) // the last sample is that of a step that is not taken
  {
    if (!own.attempt(way.q, way.v, ends.steps))
      return false;
    samples.add(ends.steps / ends.every + 1, way);
  }
  return way.v.cwiseAbs().maxCoeff() < ends.lost || cannot_go_on();
}
} // namespace condyn
