// What a benchmark is run on: a robot, its constraints and one state.
#pragma once

#include "pinocchio.hpp"

#include <Eigen/Core>
#include <filesystem>
#include <string>

namespace condyn
{

struct State
{
  Eigen::VectorXd q, v, tau;
};

struct Scene
{
  std::string name;
  pinocchio::Model model;
  Constraints constraints; // all LOCAL, joint1 moves, no Baumgarte gains
  State state;
};

/// Reads a directory written by export.py; the format is described there.
Scene load_scene(const std::filesystem::path & directory);

} // namespace condyn
