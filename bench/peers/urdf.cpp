// PROGRAM: iim_peers_urdf
// REQUIRES: urdf
// Reads a robot for the comparison from a URDF file, in a program of its own because iim/urdf.hpp is optional.
//     iim_peers_urdf FILE fixed|floating IN OUT      IN, OUT: descriptors of pipes (started by iim_peers)
#include "models.hpp"
#include "wire.hpp"

#include <iim/urdf.hpp>

#include <cstdlib>
#include <exception>
#include <filesystem>
#include <iostream>
#include <string>

int main(int argc, char** argv)
{
  if (argc != 5) {
    std::cerr << argv[0] << ": started by iim_peers\n";
    return 2;
  }
  peers::Channel channel(std::atoi(argv[3]), std::atoi(argv[4]));
  std::string failure;
  peers::Model model;
  try {
    iim::UrdfOptions<double> options;
    options.base = argv[2] == std::string("floating") ? iim::Base::floating : iim::Base::fixed;
    options.transmissions = false;  // inputs are joint torques, the same for all libraries
    options.mimic = iim::Mimic::independent;
    model = peers::describe(
        {std::filesystem::path(argv[1]).stem().string(), iim::load_urdf<double>(argv[1], options).assembly});
  } catch (const std::exception& thrown) {
    failure = thrown.what();
  }
  try {
    channel.put(failure);
    channel.put(model);
  } catch (const peers::Disconnected&) {
    return 1;
  }
  return 0;
}
