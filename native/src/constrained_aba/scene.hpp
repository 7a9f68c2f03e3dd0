// What is solved: a tree and the constraints on it, by the names of fields.
#pragma once

#include "fields.hpp"
#include "pinocchio.hpp"

#include <Eigen/StdVector>

namespace condyn
{

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
Scene read_scene(const Fields & x);

} // namespace condyn
