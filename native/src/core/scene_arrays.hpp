// A scene as it crosses the border: `condyn_pin/dynamics/compiled.py` says what each array is.
#pragma once
#include "arrays.hpp"
#include "path.hpp"

namespace condyn
{
/// A model and rows of constraints.
struct RowArrays
{
  std::vector<std::string> kinds; // of the joints, by their shortnames
  Integers parents;
  Table joints;
  List gravity, armature;
  IntegerTable constraints;
  Table of_constraints;
  List drift;
};

/// And who solves for them.
struct SceneArrays : RowArrays
{
  IntegerTable plain;
  Table of_plain, to_scene;
  List weights, verdict;
  double open_squared;
  int method;
  List proximal, rank, damping;
  Table springs;
  IntegerTable of_springs;
  IntegerTable between; // joints of springs between frames
  Table of_between;
  Integers watched;
  List nominal_pivots;
  Table wanted; // (3, rows), or (3, 0) where no row is driven
  List row_scales, move_scales, precision;
  Integers idle;
};

/// All throw std::invalid_argument where something does not fit.
Scene read_rows(const RowArrays & arrays);
Scene read_scene(const SceneArrays & arrays);
/// Where driven rows of a scene are to be at each half step of some steps.
Path read_path(const Scene & scene, const Integers & rows, const Array<const double, 3> & path, int steps);
} // namespace condyn
