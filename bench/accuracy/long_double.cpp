// PART OF: iim_accuracy
#include "variants.hpp"

namespace bench {

template <>
std::vector<Outcome> accuracy_outcomes<long double>(const AccuracyScene& scene, const AccuracyReference& reference)
{
  return outcomes_in<long double>("long double", scene, reference);
}

template <>
std::vector<Pass> accuracy_passes<long double>(const AccuracyScene& scene)
{
  return passes_in<long double>("long double", scene);
}

}  // namespace bench
