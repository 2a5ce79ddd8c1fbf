// PART OF: iim_peers
#include "several.hpp"

#include "iim.hpp"

#include <iim/several_states.hpp>

#include <algorithm>
#include <stdexcept>

namespace peers {
namespace {

template <class T>
void keep(const T& x)
{
  __asm__ volatile("" : : "g"(&x) : "memory");
}

class SeveralPeer : public Peer {
public:
  SeveralPeer(const Model& model, const std::vector<State>& states)
      : tree_(assembly(model)), inputs_(choose_inputs(tree_, model)), several_(assembly(model), inputs_),
        q_(model.n_q, static_cast<Index>(states.size())), qd_(model.n_v, static_cast<Index>(states.size()))
  {
    for (Index k = 0; k < q_.cols(); ++k) {
      q_.col(k) = states[static_cast<std::size_t>(k)].q;
      qd_.col(k) = states[static_cast<std::size_t>(k)].qd;
    }
    if (q_.cols() % Several::lanes != 0) { throw std::invalid_argument("the pool is no multiple of the lanes"); }
  }

  std::vector<Path> paths() override
  {
    return {{std::to_string(Several::lanes) + " states at once",
             [this](std::size_t k) {
               last_ = static_cast<Index>(k);
               if (last_ % Several::lanes == 0) {
                 evaluate(last_, [](const auto& dynamics) { keep(dynamics); });
               }
             },
             [this] {
               Result result;
               Index state = last_ - last_ % Several::lanes;
               evaluate(state, [&](const auto& dynamics) {
                 if (state++ == last_) { result = {dynamics.qdd0, dynamics.Bhat}; }
               });
               return result;
             }}};
  }

private:
  using Several = iim::SeveralStates<Tree>;

  template <class F>
  void evaluate(Index first, F&& f)
  {
    several_.for_each(q_.middleCols<Several::lanes>(first), qd_.middleCols<Several::lanes>(first),
                      [&](Index, const iim::AffineDynamics<double>& dynamics) { f(dynamics); });
  }

  Tree tree_;
  Inputs inputs_;
  Several several_;
  MatrixXd q_, qd_;
  Index last_ = 0;
};

}  // namespace

std::unique_ptr<Peer> several_states(const Model& model, const std::vector<State>& states)
{
  return std::make_unique<SeveralPeer>(model, states);
}

}  // namespace peers
