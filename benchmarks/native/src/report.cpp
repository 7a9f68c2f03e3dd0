#include "report.hpp"

#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace condyn
{
namespace
{

std::string json(const std::string & text)
{
  std::string escaped = "\"";
  for (const char character : text)
  {
    if (character == '"' || character == '\\')
      escaped += '\\';
    escaped += character;
  }
  return escaped + '"';
}

std::string json(double number)
{
  if (!std::isfinite(number)) // JSON has no word for it
    return "null";
  std::ostringstream text;
  text.precision(6);
  text << number;
  return text.str();
}

std::string json(int number)
{
  return std::to_string(number);
}

std::string json(const std::optional<int> & number)
{
  return number ? json(*number) : "null";
}

std::string json(const SceneRow & row)
{
  return "{\"scene\": " + json(row.scene) + ", \"nv\": " + json(row.nv)
         + ", \"rows\": " + json(row.rows) + ", \"rank\": " + json(row.rank) + "}";
}

std::string json(const Row & row)
{
  return "{\"scene\": " + json(row.scene) + ", \"method\": " + json(row.method)
         + ", \"mu\": " + json(row.mu) + ", \"iterations\": " + json(row.iterations)
         + ", \"median_us\": " + json(row.times.median_us)
         + ", \"p95_us\": " + json(row.times.p95_us) + ", \"min_us\": " + json(row.times.min_us)
         + ", \"error\": " + json(row.errors.error)
         + ", \"dynamics_error\": " + json(row.errors.dynamics_error)
         + ", \"constraint_error\": " + json(row.errors.constraint_error) + "}";
}

template<typename Item>
std::string json(const std::vector<Item> & items)
{
  std::string text = "[";
  for (std::size_t i = 0; i < items.size(); ++i)
    text += (i == 0 ? "\n    " : ",\n    ") + json(items[i]);
  return text + "\n  ]";
}

std::string cpu_model()
{
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);)
    if (line.rfind("model name", 0) == 0)
      return line.substr(line.find(':') + 2);
  return "unknown";
}

std::string eigen_version()
{
  return std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) + "."
         + std::to_string(EIGEN_MINOR_VERSION);
}

} // namespace

void write_json(const Report & report, const std::filesystem::path & path)
{
  std::ofstream file(path);
  file << "{\n  \"pinocchio\": " << json(PINOCCHIO_VERSION)
       << ",\n  \"eigen\": " << json(eigen_version())
       << ",\n  \"simd\": " << json(Eigen::SimdInstructionSetsInUse())
       << ",\n  \"compiler\": " << json(CONDYN_COMPILER)
       << ",\n  \"flags\": " << json(CONDYN_FLAGS)
       << ",\n  \"cpu\": " << json(cpu_model())
       << ",\n  \"accuracy\": " << json(report.settings.accuracy)
       << ",\n  \"max_iterations\": " << json(report.settings.max_iterations)
       << ",\n  \"repeats\": " << json(report.repeats)
       << ",\n  \"scenes\": " << json(report.scenes)
       << ",\n  \"rows\": " << json(report.rows) << "\n}\n";
  file.close();
  if (!file)
    throw std::runtime_error(path.string() + " cannot be written");
}

} // namespace condyn
