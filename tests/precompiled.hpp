// What nearly every test includes, compiled once for all of them (option IIM_TEST_PRECOMPILE). Each test still includes
// what it uses: it can be left out.
#pragma once

#include "catch.hpp"

#include <iim/iim.hpp>
#include <iim/models.hpp>
