// Before Eigen in the adapter of a library that has Eigen in its binary interface and comes as a package: such packages
// are compiled for the oldest processor of the architecture, where Eigen aligns memory to 16 bytes. With the macros of
// a newer one Eigen would align to 32 or 64, and take memory apart differently than the library put it together.
#pragma once

#if defined(EIGEN_WORLD_VERSION)
#error "peers/packaged.hpp must come before Eigen"
#endif

#undef __AVX__
#undef __AVX2__
#undef __AVX512F__
#undef __AVX512DQ__
#undef __AVX512ER__
#undef __AVX512BF16__
#undef __FMA__
#undef __F16C__
