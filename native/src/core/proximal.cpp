#include "proximal.hpp"
#include "pivots.hpp"
#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <cmath>

namespace condyn
{
namespace
{
constexpr int solves_at_most = 50; // of `freed`, most often 3, up to this change
constexpr double no_change = 1e-15;
} // namespace

Proximal::Proximal(const Scene & scene)
: Solver(scene), constraints(scene.plain), lam(VectorXd::Zero(scene.plain_rows))
, settings_(scene.proximal.absolute, scene.proximal.relative, scene.proximal.mu, scene.proximal.limit)
, mu_(scene.proximal.mu)
{
  for (auto & c : constraints)
  {
    // Pinocchio begins this list with nv zeros that are not columns: column 0 of what reads it is wrong.
    if (int(c.loop_span_indexes.size()) >= model.nv)
      c.loop_span_indexes.erase(c.loop_span_indexes.begin(), c.loop_span_indexes.begin() + model.nv);
    datas.emplace_back(c);
  }
  pinocchio::initConstraintDynamics(model, data, constraints, datas);
  for (const auto & spec : scene.plain_specs)
    approximates_ |= spec.approximates;
  if (approximates_ || scene.precision.looks_independent)
    direct_ = std::make_unique<Direct>(scene);
}

const VectorXd & Proximal::acceleration(const VectorXd & q, const VectorXd & v, const VectorXd & tau)
{
  left = nullptr;
  if (direct_)
    q_ = q;
  if (by_rows_) // one state off the constraints often follows another
  {
    direct_->look(q, v);
    by_rows_ = direct_->widest_squared() > scene.open_squared
               || (approximates_ && direct_->slip() > std::sqrt(scene.open_squared));
    if (by_rows_)
      return by_rows(q, v, tau);
  }
  answer(q, v, tau);
  if (direct_ && is_off())
  {
    direct_->look(q, v);
    return by_rows(q, v, tau);
  }
  if (!springs.w.size())
    return data.ddq;
  const MatrixXd & U = springs.U;
  const VectorXd free = U * data.ddq;
  MatrixXd G = U * freed(U.transpose());
  G.diagonal() += springs.w.cwiseInverse();
  answer(q, v, tau - U.transpose() * G.partialPivLu().solve(free));
  return data.ddq;
}

const VectorXd & Proximal::by_rows(const VectorXd & q, const VectorXd & v, const VectorXd & tau)
{
  by_rows_ = true;
  direct_->model.armature = model.armature, direct_->springs = springs;
  const VectorXd & a = direct_->answer(q, v, tau);
  left = direct_->left, iterations = direct_->iterations;
  return a;
}

void Proximal::answer(const VectorXd & q, const VectorXd & v, const VectorXd & tau)
{
  pinocchio::constraintDynamics(model, data, q, v, tau, constraints, datas, settings_);
  iterations = settings_.iter;
  mu_ = settings_.mu;
  if (scene.proximal.patient && !(settings_.relative_residual <= settings_.relative_accuracy))
    if (auto finer = better())
    {
      pinocchio::constraintDynamics(model, data, q, v, tau, constraints, datas, *finer);
      iterations += finer->iter;
      mu_ = finer->mu;
    }
  lam = data.lambda_c;
}

/// P f of some forces (nv, k), by the factor that the last answer left:
///
///   [[-mu 1, J], [J^T, M]] [y_(k+1); x] = [-mu y_k; f]
MatrixXd Proximal::freed(const MatrixXd & forces)
{
  const int m = scene.plain_rows;
  MatrixXd given = MatrixXd::Zero(m + model.nv, forces.cols()), found = given;
  given.bottomRows(model.nv) = forces;
  double before = INFINITY;
  for (int k = 0; k < solves_at_most; ++k)
  {
    const MatrixXd last = found;
    found = given;
    data.constraint_chol.solveInPlace(found);
    const double change = (found - last).bottomRows(model.nv).norm();
    if (!m || !(change < before) || change <= no_change * found.norm())
      break;
    before = change;
    given.topRows(m) = -mu_ * found.topRows(m);
  }
  return found.bottomRows(model.nv);
}

std::optional<pinocchio::ProximalSettings> Proximal::better()
{
  const ProximalPlan & plan = scene.proximal;
  MatrixXd G = data.constraint_chol.getInverseOperationalSpaceInertiaMatrix();
  G.diagonal().array() -= settings_.mu;
  const int rank = pivoted_cholesky(G);
  const double sigma = rank ? G(rank - 1, rank - 1) * G(rank - 1, rank - 1) : 0.0;
  if (!(0.0 < sigma && std::isfinite(sigma)))
    return std::nullopt;
  const bool few = !(plan.weak <= sigma && sigma <= plan.strong);
  int power;
  const double share = few ? plan.few_share : plan.usual_share;
  const double mantissa = std::frexp(std::max(share * sigma, plan.least), &power);
  const double mu = std::ldexp(std::trunc(32.0 * mantissa), power - 5); // five bits will do
  if (settings_.mu <= mu && settings_.relative_residual < plan.harmless)
    return std::nullopt; // along redundant rows: a step of lam that moves nothing
  return pinocchio::ProximalSettings(0.0, plan.finer, mu, few ? plan.few : plan.usual);
}

VectorXd Proximal::scene_forces()
{
  if (by_rows_)
    return direct_->scene_forces();
  VectorXd found = scene.to_scene.size() ? VectorXd(scene.to_scene * lam) : lam;
  if (scene.precision.looks_independent && moves()) // rows that contradict each other push without an end
  {
    left = &direct_->redundant_at(q_);
    left->leave_out_of(found);
  }
  return without_idle(found);
}

/// Gives contacts that were anchored their place.
void Proximal::begin(int rank)
{
  if (direct_)
    direct_->begin(rank);
  for (int i : scene.unanchored_plain)
  {
    constraints[i].joint2_placement = scene.plain_specs[i].placement2;
    constraints[i].m_baumgarte_parameters.Kp = scene.kp;
  }
}

/// By [[-mu 1, J], [J^T, M]] x = rhs, with the factor that the last acceleration left.
bool Proximal::close(const VectorXd & q, const VectorXd & v, VectorXd & dq, VectorXd & dv)
{
  if (by_rows_)
    answer(q, v, VectorXd::Zero(model.nv));
  gaps_.setZero(scene.plain_rows + model.nv, 2);
  int row = 0;
  for (std::size_t k = 0; k < constraints.size(); ++k)
  {
    const auto & spec = scene.plain_specs[k];
    if (spec.anchored)
      gaps_.col(0).segment(row, spec.size) = datas[k].contact_placement_error.toVector().head(spec.size);
    gaps_.col(1).segment(row, spec.size) = datas[k].contact_velocity_error.toVector().head(spec.size);
    row += spec.size;
  }
  if (mu_ != settings_.mu)
    data.constraint_chol.compute(model, data, constraints, datas, settings_.mu);
  mu_ = settings_.mu;
  data.constraint_chol.solveInPlace(gaps_);
  dq = -gaps_.col(0).tail(model.nv), dv = -gaps_.col(1).tail(model.nv);
  return true;
}

double Proximal::pivots_left()
{
  if (by_rows_)
    return direct_->pivots_left();
  // M is the last block of a matrix U D U^T: the last entries of D are its pivots
  return share_of_pivots(data.constraint_chol.D.tail(model.nv));
}

/// Whether loops are open, or what stands for other rows is not exact.
bool Proximal::is_off() const
{
  for (std::size_t k = 0; k < constraints.size(); ++k)
  {
    const auto & spec = scene.plain_specs[k];
    if (!spec.approximates && !scene.precision.looks_independent)
      continue;
    const auto & d = datas[k];
    if (spec.anchored && d.contact_placement_error.toVector().head(spec.size).squaredNorm() > scene.open_squared)
      return true;
    if (spec.approximates && d.contact_velocity_error.toVector().head(spec.size).squaredNorm() > scene.open_squared)
      return true;
  }
  return false;
}

/// Whether J v is not zero.
bool Proximal::moves() const
{
  for (std::size_t k = 0; k < constraints.size(); ++k)
    if (datas[k].contact_velocity_error.toVector().head(scene.plain_specs[k].size).squaredNorm() > scene.open_squared)
      return true;
  return false;
}
} // namespace condyn
