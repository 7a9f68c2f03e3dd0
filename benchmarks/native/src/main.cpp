// condyn_native: times constrained dynamics on exported scenes, without Python in the loop.

#include "report.hpp"

#include <exception>
#include <iostream>
#include <sstream>
#include <stdexcept>

namespace
{

const char * const usage =
  "condyn_native [options] scene_directory...\n"
  "  --output FILE        result file                        (native.json)\n"
  "  --mu LIST            proximal weights, comma separated  (1e-4,1e-6,1e-8)\n"
  "  --accuracy NUMBER    where the proximal methods stop    (1e-10)\n"
  "  --max-iterations N   and when they give up              (20)\n"
  "  --repeats N          timed calls of every method        (2000)\n";

struct Arguments
{
  std::filesystem::path output = "native.json";
  std::vector<double> mus = {1e-4, 1e-6, 1e-8};
  condyn::Settings settings;
  int repeats = 2000;
  std::vector<std::filesystem::path> scenes;
};

template<typename Number>
Number positive(const std::string & text)
{
  std::istringstream stream(text);
  Number number;
  if (!(stream >> number) || !stream.eof() || !(number > 0))
    throw std::invalid_argument("'" + text + "' is not a positive number");
  return number;
}

std::vector<double> positive_list(const std::string & text)
{
  std::vector<double> numbers;
  std::istringstream stream(text);
  for (std::string item; std::getline(stream, item, ',');)
    numbers.push_back(positive<double>(item));
  return numbers;
}

Arguments parse(const std::vector<std::string> & words)
{
  Arguments arguments;
  for (std::size_t i = 0; i < words.size(); ++i)
  {
    if (words[i].rfind("--", 0) != 0)
    {
      arguments.scenes.push_back(words[i]);
      continue;
    }
    if (i + 1 == words.size())
      throw std::invalid_argument(words[i] + " needs a value");
    const std::string & option = words[i];
    const std::string & value = words[++i];
    if (option == "--output")
      arguments.output = value;
    else if (option == "--mu")
      arguments.mus = positive_list(value);
    else if (option == "--accuracy")
      arguments.settings.accuracy = positive<double>(value);
    else if (option == "--max-iterations")
      arguments.settings.max_iterations = positive<int>(value);
    else if (option == "--repeats")
      arguments.repeats = positive<int>(value);
    else
      throw std::invalid_argument("there is no option " + option);
  }
  if (arguments.scenes.empty())
    throw std::invalid_argument("no scene is named");
  return arguments;
}

void benchmark(const condyn::Scene & scene, const Arguments & arguments, condyn::Report & report)
{
  const auto acceleration = condyn::ask_for_acceleration(scene);
  const int rows = condyn::rows(scene.constraints);
  const int rank = condyn::rank(acceleration);
  report.scenes.push_back({scene.name, scene.model.nv, rows, rank});

  const auto methods =
    condyn::make_methods(scene, rank < rows, arguments.mus, arguments.settings);
  const auto times = condyn::time_in_turns(methods, scene.state, arguments.repeats);
  for (std::size_t i = 0; i < methods.size(); ++i)
  {
    const auto answer = methods[i]->answer();
    const auto errors = condyn::judge(methods[i]->question(acceleration), answer);
    report.rows.push_back(
      {scene.name, methods[i]->name, methods[i]->mu, answer.iterations, times[i], errors});
  }
}

} // namespace

int main(int count, char ** words)
{
  try
  {
    const Arguments arguments = parse({words + 1, words + count});
    condyn::Report report{arguments.settings, arguments.repeats, {}, {}};
    for (const auto & directory : arguments.scenes)
      benchmark(condyn::load_scene(directory), arguments, report);
    condyn::write_json(report, arguments.output);
  }
  catch (const std::invalid_argument & mistake)
  {
    std::cerr << mistake.what() << "\n\n" << usage;
    return 2;
  }
  catch (const std::exception & failure)
  {
    std::cerr << failure.what() << "\n";
    return 1;
  }
}
