// Popov and Vereshchagin: the rows go in along the tree with the articulated bodies, and what
// arrives at the world is G = J M^-1 J^T and J a_free + gamma - a_ref.
//
//   lam_(k+1) = (G + mu 1)^-1 (mu lam_k - (J a_free + gamma - a_ref)),      lam_0 = 0
#include "recursion.hpp"

#include <Eigen/Cholesky>

namespace condyn
{
namespace
{

using pinocchio::JointIndex;

class Pv final : public Recursion
{
public:
  Pv(const Scene & scene, const Settings & settings)
  : Recursion(scene, settings)
  , factor_(scene.rows)
  , last_(VectorXd::Zero(scene.rows))
  {
    for (const auto & c : contacts)
    {
      int place = c.column;
      for (JointIndex i = c.joint; i > 0; i = model.parents[i])
        place += data.par_cons_ind[i];
      places_.push_back(place);
    }
  }

  int solve(const In & q, const In & v, const In & tau, Out a) override
  {
    out_along_the_tree(q, v, tau);
    for (const auto & c : contacts)
      data.lA[c.joint].segment(c.column, c.size) = lack.segment(c.row, c.size);
    for (JointIndex i = JointIndex(model.njoints) - 1; i > 0; --i)
      SweepIn::run(model.joints[i], data.joints[i], SweepIn::ArgsType(model, data));
    const int iterations = scene.rows > 0 ? forces() : 1;
    if (iterations == 0)
      return 0;
    for (JointIndex i = 1; i < JointIndex(model.njoints); ++i)
      SweepOut::run(model.joints[i], data.joints[i], SweepOut::ArgsType(model, data));
    for (std::size_t k = 0; k < contacts.size(); ++k)
      lam.segment(contacts[k].row, contacts[k].size) =
        -data.lambdaA[0].segment(places_[k], contacts[k].size);
    a = data.ddq;
    return iterations;
  }

private:
  using SweepIn = pinocchio::PvRegBackwardStep<double, 0, Joints>;
  using SweepOut = pinocchio::PvRegForwardStep2<double, 0, Joints>;

  /// Finds what Pinocchio calls lambdaA: minus the forces, in the order of the tree. Returns the
  /// iterations, and 0 if G + mu 1 is not positive definite. Only its lower half is written.
  int forces()
  {
    VectorXd & found = data.lambdaA[0];
    data.lA[0].noalias() += data.KA[0].transpose() * data.a_gf[0].toVector();
    data.LA[0].diagonal().array() += settings.mu;
    factor_.compute(data.LA[0]);
    if (factor_.info() != Eigen::Success)
      return 0;
    found = factor_.solve(data.lA[0]);
    int iterations = 1;
    double step = settings.mu > 0.0 ? found.lpNorm<Eigen::Infinity>() : 0.0;
    for (; step > settings.accuracy && iterations < settings.limit; ++iterations)
    {
      last_ = found;
      found = settings.mu * last_ + data.lA[0];
      factor_.solveInPlace(found);
      step = (found - last_).lpNorm<Eigen::Infinity>();
    }
    return iterations;
  }

  Eigen::LLT<MatrixXd> factor_;
  VectorXd last_;
  std::vector<int> places_; // of the rows of each contact where they arrive
};

} // namespace

MethodPtr make_pv(const Scene & scene, const Settings & settings)
{
  check_with_world(scene, "PV");
  return std::make_unique<Pv>(scene, settings);
}

} // namespace condyn
