// A scene, made of numbers and names: no object of Python's Pinocchio crosses the border.
#pragma once
#include "constraint.hpp"
#include "spring.hpp"
#include "verdict.hpp"
#include <limits>

namespace condyn
{
/// A constraint that Pinocchio has itself, of 3 or of 6 rows.
struct PlainSpec
{
  int size, joint1, joint2;
  SE3 placement1, placement2;
  bool anchored; // whether it has a position error
  bool approximates; // rows of another kind, exact while it is closed
};

/// What `Proximal` iterates with, as Python computed it.
struct ProximalPlan
{
  double absolute, relative, mu; // ProximalSettings
  int limit;
  bool patient; // whether another weight is looked for where these do not do
  // the weight for a state, of MuAtState:
  double finer; // [N], the step that ends it
  int usual, few; // iterations
  double usual_share, few_share; // mu / sigma
  double weak, strong, least, harmless;
};

/// tau = -d v - k (q - rest), the sum of all springs on a coordinate, and those between frames.
struct Passive
{
  VectorXd d; // by coordinate
  VectorXd k, rest; // by spring
  std::vector<int> at_q, at_v; // where q and v hold its joint
  std::vector<SpringDamper> between;
};

/// What Python knows of the rows of a scene at its nominal state.
struct Rank
{
  bool dependent; // whether there are redundant rows
  double least; // |J|^2 of a J that is more than rounding
};

/// What tells rows that are redundant where the loops are closed from others beside that: `Redundancy` in Python.
struct Precision
{
  VectorXd R, D; // scales of rows and of moves
  int floor = 0; // rank at closed states
  double least = 0, share = 0; // pivots that are rounding: below this, and below this share of the first
  double open = std::numeric_limits<double>::infinity(), moving = open; // |c| and |J v| of a state off its constraints
  double ajar = open; // |c| where rows are factorised anyway
  double doubt = open; // share of a that closing the loops changes, from which on a is not determined
  double size = 1; // usual, of a loop [m]
  bool looks_independent = false; // whether redundant rows look independent there
  std::vector<int> idle; // rows that are zero at every configuration
};

/// Who answers: `Proximal`, or `Direct` for rows that are to be independent, or for any.
enum class Method { proximal, independent, minimum_norm };

struct Scene
{
  Model model;
  std::vector<Constraint> constraints;
  std::vector<Rigid> plain; // the same as Pinocchio takes them
  std::vector<PlainSpec> plain_specs;
  std::vector<int> unanchored; // constraints that a motion anchors where it begins
  std::vector<int> unanchored_plain; // what `plain` has in their place: an edge is two points
  MatrixXd to_scene; // lam of the scene from that of `plain`; empty where they are the same
  int rows = 0, plain_rows = 0;
  double kp = 0, kd = 0; // a_ref = -kd J v - kp c
  MatrixXd wanted; // s, s' and s'' of rows that are driven, zero of others (rows, 3); empty where none is
  VectorXd weights; // of the residuals
  Verdict verdict;
  std::vector<int> watched; // pivots of M that may fall
  VectorXd nominal_pivots; // of the watched
  double open_squared; // |gap|^2 above which what is approximated is not exact
  Method method;
  ProximalPlan proximal;
  Rank rank;
  Precision precision;
  Passive passive;
};

/// Throws std::invalid_argument where something does not fit.
void add_constraints(Scene & scene, const std::vector<Constraint> & constraints, const std::vector<PlainSpec> & plain);
} // namespace condyn
