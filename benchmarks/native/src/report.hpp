// The result file.
#pragma once

#include "methods.hpp"
#include "timing.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace condyn
{

struct SceneRow
{
  std::string scene;
  int nv, rows, rank;
};

struct Row
{
  std::string scene, method;
  double mu;
  std::optional<int> iterations;
  Times times;
  Errors errors;
};

struct Report
{
  Settings settings;
  int repeats;
  std::vector<SceneRow> scenes;
  std::vector<Row> rows;
};

/// Also writes down the versions, the compiler and the processor of this program.
void write_json(const Report & report, const std::filesystem::path & path);

} // namespace condyn
