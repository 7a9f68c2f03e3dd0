#include "scene.hpp"

// Boost's (de)serialisation of every joint type is slow to compile, so it is kept in this file.
#if PINOCCHIO_MAJOR_VERSION >= 4
  #include <pinocchio/serialization.hpp>
#else
  #include <pinocchio/serialization/model.hpp>
#endif

#include <fstream>
#include <stdexcept>

namespace condyn
{
namespace
{

const int format_version = 1;

class Reader
{
public:
  explicit Reader(const std::filesystem::path & path)
  : path_(path)
  , stream_(path)
  {
    if (!stream_)
      fail("cannot be opened");
  }

  [[noreturn]] void fail(const std::string & why) const
  {
    throw std::runtime_error(path_.string() + " " + why);
  }

  void expect(const std::string & keyword)
  {
    const auto word = value<std::string>();
    if (word != keyword)
      fail("has '" + word + "' where '" + keyword + "' is due");
  }

  template<typename Value>
  Value value()
  {
    Value read;
    if (!(stream_ >> read))
      fail("ends too early or holds something that is not a number");
    return read;
  }

  Eigen::VectorXd vector(const std::string & keyword, int size)
  {
    expect(keyword);
    if (value<int>() != size)
      fail("has a " + keyword + " that does not fit the model");
    Eigen::VectorXd numbers(size);
    for (double & number : numbers)
      number = value<double>();
    return numbers;
  }

  pinocchio::SE3 placement()
  {
    pinocchio::SE3 M;
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column)
        M.rotation()(row, column) = value<double>();
    for (double & coordinate : M.translation())
      coordinate = value<double>();
    return M;
  }

  pinocchio::RigidConstraintModel constraint(const pinocchio::Model & model)
  {
    const int count = value<int>();
    if (count != 3 && count != 6)
      fail("has a constraint that is neither of 3 nor of 6 rows");
    const auto type = count == 6 ? pinocchio::CONTACT_6D : pinocchio::CONTACT_3D;
    const auto joint1 = joint(model);
    const auto placement1 = placement();
    const auto joint2 = joint(model);
    const auto placement2 = placement();
    return {type, model, joint1, placement1, joint2, placement2, pinocchio::LOCAL};
  }

private:
  pinocchio::JointIndex joint(const pinocchio::Model & model)
  {
    const auto id = value<pinocchio::JointIndex>();
    if (id >= pinocchio::JointIndex(model.njoints))
      fail("names a joint that the model does not have");
    return id;
  }

  std::filesystem::path path_;
  std::ifstream stream_;
};

} // namespace

Scene load_scene(const std::filesystem::path & directory)
{
  Scene scene;
  scene.name = std::filesystem::canonical(directory).filename().string();

  Reader reader(directory / "scene.txt");
  reader.expect("condyn_scene");
  if (reader.value<int>() != format_version)
    reader.fail("was written for another version of this program");
  reader.expect("pinocchio"); // archives of one version crash another
  if (const auto version = reader.value<std::string>(); version != PINOCCHIO_VERSION)
    reader.fail("was written by Pinocchio " + version + ", this is " + PINOCCHIO_VERSION);
  scene.model.loadFromText((directory / "model.txt").string());

  reader.expect("constraints");
  const int count = reader.value<int>();
  for (int i = 0; i < count; ++i)
    scene.constraints.push_back(reader.constraint(scene.model));
  scene.state.q = reader.vector("q", scene.model.nq);
  scene.state.v = reader.vector("v", scene.model.nv);
  scene.state.tau = reader.vector("tau", scene.model.nv);
  return scene;
}

} // namespace condyn
