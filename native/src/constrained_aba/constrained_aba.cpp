// Articulated bodies that carry their contacts: constrainedABA, and Pinocchio's own to compare with.
//
// Method of multipliers. A contact that lacks r = J a + gamma - a_ref is pushed back by r / mu: an
// inertia K K^T / mu at its body. With forces lam there already,
//
//   (M + J^T J / mu) a = tau - h - J^T (lam + (gamma - a_ref) / mu),      lam += r / mu,
//
// is one sweep in and one out over the tree, the factors of which stay as they are.
#include "recursion.hpp"

namespace condyn
{
namespace
{

using pinocchio::JointIndex;

class ConstrainedAba final : public Recursion
{
public:
  ConstrainedAba(const Scene & scene, const Settings & settings)
  : Recursion(scene, settings)
  , missing_(VectorXd::Zero(scene.rows))
  {
    for (JointIndex i = 1; i < JointIndex(model.njoints); ++i)
      (data.constraints_supported_dim[i] > 0 ? supporting_ : others_).push_back(i);
  }

  int solve(const In & q, const In & v, const In & tau, Out a) override
  {
    out_along_the_tree(q, v, tau);
    const double stiffness = 1.0 / settings.mu;
    for (const auto & c : contacts)
    {
      data.Yaba[c.joint].noalias() += c.K * stiffness * c.K.transpose();
      data.f[c.joint].toVector().noalias() += c.K * stiffness * lack.segment(c.row, c.size);
    }
    for (JointIndex i = JointIndex(model.njoints) - 1; i > 0; --i)
      Factor::run(model.joints[i], data.joints[i], Factor::ArgsType(model, data));
    sweep_out(supporting_);

    lam.setZero();
    int iterations = 1;
    // what is not a number ends it as well
    for (; residual() > settings.accuracy && iterations < settings.limit; ++iterations)
    {
      lam += stiffness * missing_;
      push(stiffness);
      sweep_out(supporting_);
    }
    sweep_out(others_);
    lam = -(lam + stiffness * missing_);
    a = data.ddq;
    return iterations;
  }

private:
  using Factor = pinocchio::cAbaBackwardStep<double, 0, Joints>;
  using SweepIn = pinocchio::PvBackwardStepReduced<double, 0, Joints>;
  using SweepOut = pinocchio::cAbaForwardStep2<double, 0, Joints>;

  /// Finds what each contact lacks now; returns the largest of that.
  double residual()
  {
    missing_ = lack;
    for (const auto & c : contacts)
      missing_.segment(c.row, c.size).noalias() += c.K.transpose() * data.a[c.joint].toVector();
    return missing_.size() > 0 ? missing_.lpNorm<Eigen::Infinity>() : 0.0;
  }

  /// Hands the torques of what is missing to the joints.
  void push(double stiffness)
  {
    for (const JointIndex i : supporting_)
      data.f[i].setZero();
    for (const auto & c : contacts)
      data.f[c.joint].toVector().noalias() += c.K * stiffness * missing_.segment(c.row, c.size);
    for (auto i = supporting_.rbegin(); i != supporting_.rend(); ++i)
      SweepIn::run(model.joints[*i], data.joints[*i], SweepIn::ArgsType(model, data));
  }

  void sweep_out(const std::vector<JointIndex> & joints)
  {
    for (const JointIndex i : joints)
      SweepOut::run(model.joints[i], data.joints[i], SweepOut::ArgsType(model, data));
  }

  VectorXd missing_;
  std::vector<JointIndex> supporting_, others_; // joints that a contact hangs on, and all others
};

/// As it is. Its lam is not handed out: it stays zero.
class PinocchiosConstrainedAba final : public Method
{
public:
  PinocchiosConstrainedAba(const Scene & scene, const Settings & settings)
  : Method(scene, settings)
  , data_(scene.model)
  , settings_(settings.accuracy, settings.mu, settings.limit)
  {
    for (const auto & constraint : scene.constraints)
      datas_.emplace_back(constraint);
    pinocchio::initPvSolver(model, data_, scene.constraints);
  }

  int solve(const In & q, const In & v, const In & tau, Out a) override
  {
    a = pinocchio::constrainedABA(model, data_, q, v, tau, scene.constraints, datas_, settings_);
    return 1;
  }

private:
  Data data_;
  PINOCCHIO_ALIGNED_STD_VECTOR(RigidData) datas_;
  pinocchio::ProximalSettings settings_;
};

} // namespace

MethodPtr make_constrained_aba(const Scene & scene, const Settings & settings)
{
  check_with_world(scene, "ConstrainedABA");
  return std::make_unique<ConstrainedAba>(scene, settings);
}

MethodPtr make_pinocchios_constrained_aba(const Scene & scene, const Settings & settings)
{
  check_with_world(scene, "pinocchio::constrainedABA");
  return std::make_unique<PinocchiosConstrainedAba>(scene, settings);
}

} // namespace condyn
