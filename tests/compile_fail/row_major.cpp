// EXPECT: do not define EIGEN_DEFAULT_TO_ROW_MAJOR
#ifndef IIM_CORRECT
#define EIGEN_DEFAULT_TO_ROW_MAJOR
#endif
#include <iim/iim.hpp>

int main() {}
