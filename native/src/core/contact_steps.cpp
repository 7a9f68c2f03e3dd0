#include "contact_steps.hpp"
#include "contact_solve.hpp"
#include <algorithm>
#include <cmath>

namespace condyn
{
namespace
{
constexpr int again_at_most = 6; // as `_AGAIN`
constexpr int closings_at_most = 10; // as `_CLOSINGS`
constexpr double held_share = 1e-22; // as `_HELD`

double largest(const VectorXd & x) { return x.size() ? x.cwiseAbs().maxCoeff() : 0.0; }
} // namespace

ContactSteps::ContactSteps(const Scene & scene, const Candidates & candidates, int rank)
: candidates(candidates), scene_(scene), mechanics_(scene_.model), rows_(scene_.rows), rank_(rank)
, still_(VectorXd::Zero(scene.model.nv)), on_joint_(scene.model.njoints, Force::Zero())
{
  const Model & model = scene_.model;
  for (int j = 1; j < model.njoints; ++j)
    if (model.nvs[j] == 6)
      floating_.emplace_back(model.idx_qs[j], model.idx_vs[j]);
  at_.resize(model.nq), ends_.resize(model.nq), q.resize(model.nq);
}

void ContactSteps::begin(const StepPlan & plan, const VectorXd & applied)
{
  plan_ = plan, applied_ = applied;
  for (int i : scene_.unanchored) // of a motion before
    scene_.constraints[i].anchored = false;
  const Passive & passive = scene_.passive;
  stiffness_.setZero(scene_.model.nv);
  for (Eigen::Index s = 0; s < passive.k.size(); ++s)
    stiffness_[passive.at_v[s]] += passive.k[s];
  inertia_ = plan.dt * passive.d + plan.dt * plan.dt * stiffness_;
}

void ContactSteps::anchor(const VectorXd & q)
{
  if (scene_.unanchored.empty())
    return;
  mechanics_.place(q);
  for (int i : scene_.unanchored)
  {
    Constraint & c = scene_.constraints[i];
    c.placement2 = mechanics_.data.oMi[c.joint1] * c.placement1;
    c.anchored = true;
  }
}

bool ContactSteps::fits(const VectorXd & q, const VectorXd & v, double closed)
{
  mechanics_.move(q, v, still_);
  rows_.evaluate(scene_, mechanics_.data, q, v, still_);
  candidates.gaps(mechanics_.data, q, gaps_);
  const double deepest = gaps_.size() ? gaps_.minCoeff() : 0.0;
  return std::max(largest(rows_.c), largest(rows_.velocity)) < closed && deepest > -plan_.deep;
}

bool ContactSteps::turns_too_far(const VectorXd & v) const
{
  const Model & model = scene_.model;
  if (!(v.squaredNorm() > M_PI * M_PI / (plan_.dt * plan_.dt)))
    return false;
  for (int j = 1; j < model.njoints; ++j)
    if (model.nvs[j] > 1 && !(v.segment<3>(model.idx_vs[j] + model.nvs[j] - 3).norm() * plan_.dt <= M_PI))
      return true;
  return false;
}

// ------------------------------------------------------------------------------------------------
// Floating bodies: their velocities in axes that stand still within a step.

VectorXd ContactSteps::turned(const VectorXd & v, double dt) const
{
  VectorXd found = v;
  for (const auto & [q_, i] : floating_)
    found.segment<3>(i) = pinocchio::exp3(Vector3d(-dt * v.segment<3>(i + 3))) * v.segment<3>(i);
  return found;
}

VectorXd ContactSteps::turning(const VectorXd & v) const
{
  VectorXd found = VectorXd::Zero(v.size());
  for (const auto & [q_, i] : floating_)
    found.segment<3>(i) = Vector3d(v.segment<3>(i + 3)).cross(Vector3d(v.segment<3>(i)));
  return found;
}

void ContactSteps::rows_before(MatrixXd & J, const VectorXd & v) const
{
  for (const auto & [q_, i] : floating_)
  {
    const Matrix3d turn = pinocchio::exp3(Vector3d(-plan_.dt * v.segment<3>(i + 3)));
    J.middleCols<3>(i) = (J.middleCols<3>(i) * turn).eval();
    J.middleCols<3>(i + 3) = (J.middleCols<3>(i + 3) * turn).eval();
  }
}

void ContactSteps::integrate(const VectorXd & q, const VectorXd & along, VectorXd & moved)
{
  mechanics_.integrate(q, along, moved);
  for (const auto & [k, i] : floating_)
  {
    const Eigen::Quaterniond turn(q[k + 6], q[k + 3], q[k + 4], q[k + 5]);
    moved.segment<3>(k) = q.segment<3>(k) + turn * Vector3d(along.segment<3>(i));
  }
}

// ------------------------------------------------------------------------------------------------
// The robot: M, h, what constraints block, and the step without contacts.

bool ContactSteps::factorise(const VectorXd & q, MatrixXd & M)
{
  mechanics_.mass(q, M);
  M_ = M;
  M.diagonal() += inertia_;
  const Eigen::LLT<Eigen::Ref<MatrixXd>> factor(M);
  L_ = M.triangularView<Eigen::Lower>();
  return factor.info() == Eigen::Success;
}

/// J_b, after joint Jacobians: what a unit velocity of each coordinate does to the slips.
void ContactSteps::jacobian(MatrixXd & J)
{
  const Model & model = scene_.model;
  const Data & data = mechanics_.data;
  J.setZero(scene_.rows, model.nv);
  const auto moves = [&](int joint, int column) {
    for (auto j = joint; j > 0; j = int(model.parents[j]))
      if (model.idx_vs[j] <= column && column < model.idx_vs[j] + model.nvs[j])
        return true;
    return false;
  };
  for (const auto & k : scene_.constraints)
  {
    if (k.kind == Kind::coupling)
    {
      J(k.first, k.v_a) += k.sign, J(k.first, k.v_b) -= k.sign * k.length;
      continue;
    }
    const SE3 E1 = data.oMi[k.joint1] * k.placement1, E2 = data.oMi[k.joint2] * k.placement2;
    const SE3 seen2(E1.rotation(), E2.translation()); // at c2, in the axes of c1
    const Vector3d r = E1.actInv(E2).translation();
    for (int column = 0; column < model.nv; ++column)
    {
      const bool first = moves(k.joint1, column), second = k.kind != Kind::held && moves(k.joint2, column);
      if (!first && !second)
        continue;
      const Motion along(data.J.col(column).head<3>(), data.J.col(column).tail<3>()), none(Motion::Zero());
      const Motion one = first ? E1.actInv(along) : none;
      const Motion two = !second ? none : k.kind == Kind::weld ? E1.actInv(along) : seen2.actInv(along);
      Vector6d slip = (one - two).toVector();
      if (k.kind == Kind::cut || k.kind == Kind::rod)
        slip.head<3>() += one.angular().cross(r);
      if (k.kind == Kind::rod)
        J(k.first, column) = k.sign * slip.head<3>().dot(r) / std::max(r.norm(), 1e-300);
      else
        for (int i = 0; i < k.size; ++i)
          J(k.first + i, column) = k.sign * slip[k.selection[i]];
    }
  }
}

bool ContactSteps::pose_robot(const VectorXd & q, const VectorXd & v)
{
  const Passive & passive = scene_.passive;
  at_ = q, v0_ = v;
  tau_ = applied_ - (passive.d + plan_.dt * stiffness_).cwiseProduct(v);
  for (Eigen::Index s = 0; s < passive.k.size(); ++s)
    tau_[passive.at_v[s]] -= passive.k[s] * (q[passive.at_q[s]] - passive.rest[s]);
  MatrixXd & M = whitened_;
  if (!factorise(q, M))
    return false;
  h_ = mechanics_.bias(q, v);
  slip_.resize(0);
  blocked_.rank = 0;
  if (scene_.rows)
  {
    mechanics_.move(q, v, still_);
    rows_.evaluate(scene_, mechanics_.data, q, v, still_);
    slip_ = rows_.acceleration; // gamma
  }
  mechanics_.jacobians(q);
  if (scene_.rows)
  {
    jacobian(J_b_);
    slip_ = -0.5 * plan_.dt * (slip_ - J_b_ * turning(v));
    whitened_ = L_.triangularView<Eigen::Lower>().solve(J_b_.transpose());
    blocked_.compute(whitened_, plan_.rank_tolerance);
    if (blocked_.rank > rank_)
      return false;
    held_ = blocked_.held(slip_);
  }
  candidates.gaps(mechanics_.data, q, gaps_);
  candidates.rows(mechanics_.data, J_);
  condense(v);
  return true;
}

/// L^T v_free, with h of a mean velocity.
void ContactSteps::condense(const VectorXd & mean)
{
  mean_ = mean, turning_ = turning(mean);
  const auto L = L_.triangularView<Eigen::Lower>();
  const VectorXd p = plan_.dt * (tau_ - h_ + M_ * turning_);
  free_ = L_.transpose() * v0_ + L.solve(p);
  if (!blocked_.rank)
    return;
  momentum_ = blocked_.V.transpose() * free_;
  free_ += blocked_.V * (held_ - momentum_);
}

// ------------------------------------------------------------------------------------------------
// The contacts that take part.

double ContactSteps::allowed(double gap) const
{
  return gap > plan_.touches ? gap : gap < -plan_.at_rest ? plan_.pushed_out * gap : 0.0;
}

void ContactSteps::choose(const Flags & active)
{
  posed_.active = active;
  posed_.chosen.clear();
  posed_.with_gaps = 0;
  ContactProblem & problem = posed_.problem;
  int cones = 0;
  for (int i = 0; i < candidates.count(); ++i)
    if (active[i])
    {
      posed_.chosen.push_back(i);
      posed_.with_gaps += i < candidates.with_gaps();
      cones += i < candidates.cones();
    }
  problem.half_lines = posed_.with_gaps - cones;
  problem.friction.resize(cones);
  problem.limits.resize(posed_.chosen.size() - posed_.with_gaps);
  for (int i = 0; i < cones; ++i)
    problem.friction[i] = candidates.touches[posed_.chosen[i]].friction;
  for (Eigen::Index i = 0; i < problem.limits.size(); ++i)
    problem.limits[i] = plan_.dt * candidates.dry[posed_.chosen[posed_.with_gaps + i] - candidates.with_gaps()].limit;
}

/// Takes the rows of the chosen from those of all, and eliminates the constraints.
void ContactSteps::eliminate()
{
  MatrixXd & J_c = posed_.J_c;
  const MatrixXd & all = posed_.along_path ? J_there_ : J_;
  const int rows = posed_.problem.lines() + int(posed_.chosen.size()) - posed_.problem.cones();
  J_c.resize(rows, all.cols());
  int row = 0;
  for (int i : posed_.chosen)
  {
    J_c.middleRows(row, candidates.size(i)) = all.middleRows(candidates.first(i), candidates.size(i));
    row += candidates.size(i);
  }
  MatrixXd & X = posed_.X;
  X = J_c.transpose();
  L_.triangularView<Eigen::Lower>().solveInPlace(X);
  if (blocked_.rank)
  {
    posed_.blocked = blocked_.V.transpose() * X;
    X.noalias() -= blocked_.V * posed_.blocked;
    // a row that constraints hold is theirs alone: what is left of it is rounding
    for (int i = 0; i < X.cols(); ++i)
      if (X.col(i).squaredNorm() <= held_share * posed_.blocked.col(i).squaredNorm())
        X.col(i).setZero(), posed_.blocked.col(i).setZero();
  }
  posed_.before.noalias() = J_c * v0_;
}

/// G and g of gaps and bends of the chosen that have them.
void ContactSteps::ask(const VectorXd & gaps, const VectorXd & bends)
{
  ContactProblem & problem = posed_.problem;
  posed_.gaps = gaps, posed_.bends = bends;
  problem.G.noalias() = posed_.X.transpose() * posed_.X;
  problem.g.noalias() = posed_.X.transpose() * free_;
  if (blocked_.rank)
    problem.g.noalias() += posed_.blocked.transpose() * held_;
  for (int i = 0; i < posed_.with_gaps; ++i)
  {
    const int n = problem.normal(i);
    problem.g[n] += (bends[i] + allowed(gaps[i])) / plan_.dt;
    if (problem.G(n, n) == 0.0) // constraints hold it: it goes where they go
      problem.g[n] = std::max(problem.g[n], 0.0);
  }
}

/// The chosen contacts as they are where the step begins.
void ContactSteps::pose()
{
  posed_.along_path = false;
  eliminate();
  VectorXd here(posed_.with_gaps), bends = VectorXd::Zero(posed_.with_gaps);
  for (int i = 0; i < posed_.with_gaps; ++i)
    here[i] = gaps_[posed_.chosen[i]];
  if (posed_.problem.cones())
  {
    integrate(at_, plan_.dt * v0_, ends_);
    mechanics_.place(ends_);
    candidates.heights(mechanics_.data, gap_there_);
    for (int i = 0; i < posed_.problem.cones(); ++i)
      bends[i] = gap_there_[posed_.chosen[i]] - here[i] - plan_.dt * posed_.before[3 * i + 2];
  }
  ask(here, bends);
}

/// The step again, with contacts as they are where a path along u ends.
void ContactSteps::pose_along(const VectorXd & u)
{
  integrate(at_, plan_.dt * u, ends_);
  mechanics_.jacobians(ends_);
  candidates.gaps(mechanics_.data, ends_, gap_there_);
  candidates.rows(mechanics_.data, J_there_);
  rows_before(J_there_, u);
  Flags active = posed_.active;
  for (int i = 0; i < candidates.with_gaps(); ++i)
    active[i] = active[i] || gap_there_[i] < 0;
  choose(active);
  posed_.along_path = true, posed_.path = u;
  eliminate();
  const VectorXd speeds = posed_.J_c * u;
  VectorXd here(posed_.with_gaps), bends(posed_.with_gaps);
  for (int i = 0; i < posed_.with_gaps; ++i)
  {
    here[i] = gaps_[posed_.chosen[i]];
    bends[i] = gap_there_[posed_.chosen[i]] - here[i] - plan_.dt * speeds[posed_.problem.normal(i)];
  }
  ask(here, bends);
}

bool ContactSteps::solve()
{
  natural = solve_contact(posed_.problem, plan_.sticks_first, plan_.solved, posed_.lam);
  if (!(natural <= plan_.solved))
    return false;
  // any impulse on what constraints hold meets the law: the smallest is none
  const MatrixXd & G = posed_.problem.G;
  for (int i = 0; i < posed_.with_gaps; ++i)
  {
    const int n = posed_.problem.normal(i), size = i < posed_.problem.cones() ? 3 : 1;
    if (G.diagonal().segment(n + 1 - size, size).isZero(0.0))
      posed_.lam.segment(n + 1 - size, size).setZero();
  }
  VectorXd & v1 = posed_.v1;
  v1 = free_;
  if (posed_.lam.size())
    v1.noalias() += posed_.X * posed_.lam;
  L_.transpose().triangularView<Eigen::Upper>().solveInPlace(v1);
  return v1.allFinite();
}

// ------------------------------------------------------------------------------------------------
// The step.

/// With all contacts that the step closes, as they are where it begins.
bool ContactSteps::answer()
{
  const double reach = std::max(plan_.near, 2 * plan_.dt * largest(v0_));
  Flags active(candidates.count(), 1);
  for (int i = 0; i < candidates.with_gaps(); ++i)
    active[i] = gaps_[i] < reach;
  while (true)
  {
    choose(active);
    if (posed_.chosen.empty()) // h at the mean velocity, for nothing touches
    {
      const VectorXd alone = L_.transpose().triangularView<Eigen::Upper>().solve(free_);
      const VectorXd mean = 0.5 * (v0_ + alone), h = h_;
      h_ = mechanics_.bias(at_, mean);
      condense(mean);
      h_ = h;
    }
    else if (mean_ != v0_)
      condense(v0_);
    pose();
    if (!solve())
      return false;
    bool is_missed = false;
    for (int i = 0; i < candidates.with_gaps(); ++i)
      if (!active[i] && gaps_[i] + plan_.dt * J_.row(candidates.normal(i)).dot(posed_.v1) < 0)
        active[i] = is_missed = true;
    if (!is_missed)
      return true;
  }
}

/// How far from where it should a contact ends at most, too deep or pressed on before it touches.
double ContactSteps::off()
{
  const VectorXd & v1 = posed_.v1;
  if (plan_.dt * largest(v1) < plan_.straight && largest(posed_.bends) < plan_.missed && !posed_.along_path)
    return 0.0;
  integrate(at_, plan_.dt * v1, ends_);
  mechanics_.place(ends_);
  candidates.gaps(mechanics_.data, ends_, gap_there_);
  for (Eigen::Index i = 0; i < gap_there_.size(); ++i)
    gap_there_[i] -= gaps_[i] - allowed(gaps_[i]);
  double worst = gap_there_.size() ? std::max(0.0, -gap_there_.minCoeff()) : 0.0;
  const Scale scale(posed_.problem);
  const VectorXd sigma = posed_.problem.velocities(posed_.lam);
  for (int i = 0; i < posed_.with_gaps; ++i)
  {
    const int n = posed_.problem.normal(i);
    if (!(posed_.lam[n] * scale.stiff > std::abs(sigma[n])))
      continue;
    worst = std::max(worst, gap_there_[posed_.chosen[i]] - plan_.dt * sigma[n]);
    if (!posed_.along_path)
      worst = std::max(worst, -posed_.bends[i]);
  }
  return worst;
}

bool ContactSteps::attempt(const VectorXd & q0, const VectorXd & v0)
{
  if (!pose_robot(q0, v0) || !answer())
    return false;
  double off_by = off();
  if (off_by > plan_.missed)
  {
    Posed best = posed_;
    double least = off_by, its_natural = natural;
    for (int tried = 1; off_by > plan_.missed && tried <= again_at_most; ++tried)
    {
      pose_along(posed_.along_path ? VectorXd(0.5 * (posed_.path + posed_.v1)) : posed_.v1);
      if (!solve())
        return false;
      off_by = off();
      if (off_by < least)
        best = posed_, least = off_by, its_natural = natural;
    }
    posed_ = std::move(best), natural = its_natural;
  }
  ended_ = posed_.v1;
  a = (ended_ - v0_) / plan_.dt - turning_;
  v = turned(ended_, plan_.dt);
  work = work_of_contacts();
  integrate(at_, plan_.dt * ended_, q);
  if (!close_loops())
    return false;
  return v.allFinite() && std::isfinite(q.squaredNorm() + ended_.squaredNorm() + work.sum());
}

/// What friction and impacts took, what pushing out gave, and what impulses gave against the laws of contact.
///
///   W = lam . (J_c v + J_c v+) / 2,    pushed out: lam_n p / 2 with p = 0.2 max(-gap, 0) / dt
Vector3d ContactSteps::work_of_contacts() const
{
  if (!posed_.lam.size())
    return Vector3d::Zero();
  const double all = 0.5 * posed_.lam.dot(posed_.before + posed_.J_c * ended_);
  double now = 0, left = 0;
  for (int i = 0; i < posed_.with_gaps; ++i)
    if (posed_.gaps[i] < -plan_.at_rest)
    {
      const int n = posed_.problem.normal(i);
      now -= 0.5 * posed_.lam[n] * allowed(posed_.gaps[i]) / plan_.dt;
      left += 0.5 * posed_.lam[n] * std::max(posed_.before[n], 0.0);
    }
  const double correction = now + std::min(left, std::max(all - now, 0.0)), rest = all - correction;
  return {std::min(rest, 0.0), correction, std::max(rest, 0.0)};
}

double ContactSteps::energy(const VectorXd & q, const VectorXd & v)
{
  double four[4], springs = 0;
  measure(q, v, four);
  const Passive & passive = scene_.passive;
  for (Eigen::Index s = 0; s < passive.k.size(); ++s)
    springs += passive.k[s] * std::pow(q[passive.at_q[s]] - passive.rest[s], 2) / 2;
  return four[2] + four[3] + springs;
}

/// Takes q to where loops are closed, by the factors of the step, and counts the work of that.
bool ContactSteps::close_loops()
{
  if (!blocked_.rank)
    return true;
  VectorXd closed = q;
  moved_.resize(q.size());
  const VectorXd open = q;
  double least = INFINITY;
  bool moves = false;
  for (int k = 0; k < closings_at_most; ++k)
  {
    mechanics_.move(q, still_, still_);
    rows_.evaluate(scene_, mechanics_.data, q, still_, still_);
    const double gap = largest(rows_.c);
    if (!(gap < least)) // rounding, or out of reach
      break;
    moves = k > 0, closed = q, least = gap;
    if (gap <= plan_.closed)
      break;
    if (gap > plan_.small) // it takes other factors, which Python makes
      return false;
    VectorXd along = -(blocked_.V * blocked_.held(rows_.c));
    L_.transpose().triangularView<Eigen::Upper>().solveInPlace(along);
    mechanics_.integrate(q, along, moved_);
    q.swap(moved_);
  }
  q = closed;
  if (moves)
    work[1] += energy(q, v) - energy(open, v);
  return true;
}

// ------------------------------------------------------------------------------------------------
// What there is to say of the last step.

VectorXd ContactSteps::impulses()
{
  VectorXd all = VectorXd::Zero(scene_.rows + candidates.rows());
  if (blocked_.rank)
  {
    VectorXd missing = held_ - momentum_;
    if (posed_.lam.size())
      missing -= posed_.blocked * posed_.lam;
    all.head(scene_.rows) = blocked_.impulses(missing);
  }
  int row = 0;
  for (int i : posed_.chosen)
  {
    all.segment(scene_.rows + candidates.first(i), candidates.size(i)) = posed_.lam.segment(row, candidates.size(i));
    row += candidates.size(i);
  }
  return all;
}

Eigen::VectorXi ContactSteps::modes() const
{
  Eigen::VectorXi all = Eigen::VectorXi::Zero(candidates.count());
  if (posed_.lam.size())
    all(posed_.chosen) = contact_modes(posed_.problem, posed_.lam, plan_.moves);
  return all;
}

void ContactSteps::forget_wrenches()
{
  for (auto & f : on_joint_)
    f.setZero();
  torque_.setZero(scene_.model.nv);
}

void ContactSteps::errors(double * eight)
{
  const VectorXd lam = impulses() / plan_.dt, gained = (ended_ - v0_) / plan_.dt;
  const VectorXd of_contacts = lam.tail(candidates.rows());
  const Data & data = mechanics_.data;
  VectorXd tau = tau_ - inertia_.cwiseProduct(gained);
  if (posed_.along_path) // what contacts do where the path ends, in the axes of its beginning
  {
    integrate(at_, plan_.dt * posed_.path, ends_);
    mechanics_.place(ends_);
    forget_wrenches();
    candidates.push(data, of_contacts, on_joint_, torque_);
    const VectorXd held = mechanics_.inverse_dynamics(ends_, still_, still_, on_joint_);
    for (auto & f : on_joint_)
      f.setZero();
    MatrixXd pushed = (mechanics_.inverse_dynamics(ends_, still_, still_, on_joint_) - held).transpose();
    rows_before(pushed, posed_.path);
    tau += torque_ + pushed.transpose();
  }
  mechanics_.move(at_, mean_, still_);
  forget_wrenches();
  if (!posed_.along_path)
    candidates.push(data, of_contacts, on_joint_, torque_);
  add_wrenches(scene_, data, lam.head(scene_.rows), on_joint_, torque_);
  const VectorXd left = mechanics_.inverse_dynamics(at_, mean_, a, on_joint_) - tau - torque_;
  double slipped = 0;
  if (scene_.rows)
  {
    mechanics_.move(at_, v0_, still_);
    rows_.evaluate(scene_, data, at_, v0_, still_);
    const VectorXd wanted = -0.5 * plan_.dt * rows_.acceleration, velocity = ended_ + 0.5 * plan_.dt * (a - gained);
    mechanics_.move(at_, velocity, still_);
    rows_.evaluate(scene_, data, at_, velocity, still_);
    slipped = largest(rows_.velocity - wanted);
  }
  mechanics_.move(q, still_, still_);
  rows_.evaluate(scene_, data, q, still_, still_);
  candidates.gaps(data, q, gap_there_);
  eight[0] = natural, eight[1] = plan_.dt * largest(left), eight[2] = slipped, eight[3] = largest(rows_.c);
  eight[4] = gap_there_.size() ? std::max(0.0, -gap_there_.minCoeff()) : 0.0;
  eight[5] = 0.0 - work[0], eight[6] = work[1], eight[7] = work[2];
}

void ContactSteps::measure(const VectorXd & q, const VectorXd & v, double * four)
{
  const Model & model = scene_.model;
  const Data & data = mechanics_.data;
  mechanics_.move(q, v, still_);
  rows_.evaluate(scene_, data, q, v, still_);
  double kinetic = v.cwiseAbs2().dot(model.armature) / 2, potential = 0;
  for (int i = 1; i < model.njoints; ++i)
  {
    const auto & Y = model.inertias[i];
    kinetic += Y.vtiv(data.v[i]) / 2;
    potential -= Y.mass() * (data.oMi[i].act(Y.lever())).dot(model.gravity.linear());
  }
  four[0] = largest(rows_.c), four[1] = largest(rows_.velocity), four[2] = kinetic, four[3] = potential;
}
} // namespace condyn
