// A scene as it crosses the border: `condyn_pin/dynamics/compiled.py` describes it, by the names of fields.
#pragma once
#include "arrays.hpp"
#include "fields.hpp"
#include "path.hpp"

namespace condyn
{
/// Kinds of joints that are compiled.
std::vector<std::string> joint_kinds();

/// All throw std::invalid_argument where something does not fit.
/// A model and rows of constraints,
Scene read_rows(const Fields & x);
/// and who solves for them.
Scene read_scene(const Fields & x);
/// Where driven rows of a scene are to be at each half step of some steps.
Path read_path(const Scene & scene, const Fields & x, int steps);
} // namespace condyn
