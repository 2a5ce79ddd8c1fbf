// The component `urdf`: the header is found, and liburdfdom is linked.
#include <urdf_parser/urdf_parser.h>
#include <iim/urdf.hpp>

int main() { return urdf::parseURDF("<robot name='point'><link name='base'/></robot>") != nullptr ? 0 : 1; }
