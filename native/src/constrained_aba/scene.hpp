// What is solved: a tree and the constraints on it, made from numbers and names.
#pragma once

#include "pinocchio.hpp"

#include <Eigen/StdVector>

#include <string>

namespace condyn
{

/// One joint and the body that it carries.
struct JointNumbers
{
  std::string kind; // as Pinocchio's shortname
  int parent;
  Eigen::Matrix<double, 6, 2> S; // what it moves along at its neutral place; one column if it has one
  pinocchio::SE3 placement;      // in the parent
  double mass;                   // [kg]
  Eigen::Vector3d lever;         // centre of mass [m]
  Eigen::Matrix3d inertia;       // about it [kg m^2]
};

/// 3 or 6 rows: a frame of a moving joint is held at one of another joint, or of the world.
struct ConstraintNumbers
{
  int rows;
  int joint1, joint2;
  pinocchio::SE3 placement1, placement2;
  double Kp, Kd; // of Baumgarte [1/s^2], [1/s]
};

struct Scene
{
  Model model;
  PINOCCHIO_ALIGNED_STD_VECTOR(Rigid) constraints; // LOCAL; Baumgarte's gains beside them
  std::vector<double> Kp, Kd;
  int rows = 0;

  int size(std::size_t k) const { return constraints[k].type == pinocchio::CONTACT_6D ? 6 : 3; }
};

/// Kinds of joints that are compiled.
std::vector<std::string> joint_kinds();

/// Throws std::invalid_argument for a kind of joint that is not compiled, and for numbers that
/// name no joint.
Scene make_scene(
  const std::vector<JointNumbers> & joints, const Eigen::Vector3d & gravity, const VectorXd & armature,
  const std::vector<ConstraintNumbers> & constraints);

} // namespace condyn
