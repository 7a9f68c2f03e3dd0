// What may touch, as it crosses the border: `condyn_pin/dynamics/compiled.py` says what each array is.
#pragma once
#include "arrays.hpp"
#include "candidates.hpp"

namespace condyn
{
struct ContactArrays
{
  IntegerTable touches;
  Table of_touches;
  IntegerTable pairs;
  Table of_pairs;
  std::vector<Integers> shapes; // two of each pair
  std::vector<List> of_shapes;
  IntegerTable stops;
  Table of_stops;
  Integers dry;
  List of_dry;
};

/// Throws std::invalid_argument where something does not fit.
Candidates read_contacts(const Model & model, const ContactArrays & arrays);
} // namespace condyn
