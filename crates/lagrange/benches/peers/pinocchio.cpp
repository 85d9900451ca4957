// Times Pinocchio's C++ on one robot: pinocchio URDF fixed|floating. Prints one line of JSON, ns of thread CPU time per call.
//
// Templates are instantiated in this file, so that the compiler's flags reach the algorithms. Each call runs over 64 random states,
// tangent vectors in [-1, 1] from the neutral configuration; a figure is the median of REPEATS batches of at least BATCH_NS each.
// crba and aba are called as they are by default (in world axes) and, as _local, in the bodies' axes.
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <pinocchio/multibody.hpp>
#include <pinocchio/parsers/urdf.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/energy.hpp>

namespace {

constexpr int STATES = 64;
constexpr int REPEATS = 9;
constexpr double BATCH_NS = 10e6;

double cpu_ns() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e9 * static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec);
}

/// What the calls return is added up here, so that none of them can be left out.
volatile double sink = 0;

template <class Call>
double batch(Call &call, long count) {
  const double start = cpu_ns();
  double sum = 0;
  for (long k = 0; k < count; ++k) sum += call(static_cast<int>(k % STATES));
  const double time = cpu_ns() - start;
  sink = sink + sum;
  return time;
}

template <class Call>
double ns_per_call(Call call) {
  long count = STATES;
  while (batch(call, count) < BATCH_NS) count *= 2;
  std::vector<double> times;
  for (int k = 0; k < REPEATS; ++k) times.push_back(batch(call, count) / static_cast<double>(count));
  std::nth_element(times.begin(), times.begin() + REPEATS / 2, times.end());
  return times[REPEATS / 2];
}

}  // namespace

int main(int argc, char **argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: pinocchio URDF fixed|floating\n");
    return 2;
  }
  const std::string path = argv[1], base = argv[2];
  pinocchio::Model model;
  if (base == "floating")
    pinocchio::urdf::buildModel(path, pinocchio::JointModelFreeFlyer(), model);
  else
    pinocchio::urdf::buildModel(path, model);
  pinocchio::Data data(model);

  std::mt19937_64 generator(20);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto tangent = [&] {
    Eigen::VectorXd x(model.nv);
    for (auto &entry : x) entry = uniform(generator);
    return x;
  };
  std::vector<Eigen::VectorXd> q, v, a;
  for (int k = 0; k < STATES; ++k) {
    q.push_back(pinocchio::integrate(model, pinocchio::neutral(model), tangent()));
    v.push_back(tangent());
    a.push_back(tangent());
  }

  using namespace pinocchio;
  const std::vector<std::pair<const char *, double>> figures = {
      {"rnea", ns_per_call([&](int k) { return rnea(model, data, q[k], v[k], a[k])[0]; })},
      {"nle", ns_per_call([&](int k) { return nonLinearEffects(model, data, q[k], v[k])[0]; })},
      {"gravity", ns_per_call([&](int k) { return computeGeneralizedGravity(model, data, q[k])[0]; })},
      {"crba", ns_per_call([&](int k) { return crba(model, data, q[k])(0, 0); })},
      {"crba_local", ns_per_call([&](int k) { return crba(model, data, q[k], Convention::LOCAL)(0, 0); })},
      {"coriolis", ns_per_call([&](int k) { return computeCoriolisMatrix(model, data, q[k], v[k])(0, 0); })},
      {"M_C_G_together", ns_per_call([&](int k) {
         crba(model, data, q[k]);
         computeCoriolisMatrix(model, data, q[k], v[k]);
         computeGeneralizedGravity(model, data, q[k]);
         return data.M(0, 0) + data.C(0, 0) + data.g[0];
       })},
      {"aba", ns_per_call([&](int k) { return aba(model, data, q[k], v[k], a[k])[0]; })},
      {"aba_local", ns_per_call([&](int k) { return aba(model, data, q[k], v[k], a[k], Convention::LOCAL)[0]; })},
      {"rnea_derivatives", ns_per_call([&](int k) {
         computeRNEADerivatives(model, data, q[k], v[k], a[k]);
         return data.dtau_dq(0, 0);
       })},
      {"aba_derivatives", ns_per_call([&](int k) {
         computeABADerivatives(model, data, q[k], v[k], a[k]);
         return data.ddq_dq(0, 0);
       })},
      {"energy", ns_per_call([&](int k) {
         return computeKineticEnergy(model, data, q[k], v[k]) + computePotentialEnergy(model, data, q[k]);
       })},
  };

  const std::string file = path.substr(path.find_last_of('/') + 1);
  std::printf("{\"tool\": \"pinocchio\", \"version\": \"%s\", \"robot\": \"%s\", \"base\": \"%s\", \"nv\": %d, \"unit\": \"ns\"",
              PINOCCHIO_VERSION, file.substr(0, file.rfind('.')).c_str(), base.c_str(), model.nv);
  for (const auto &figure : figures) std::printf(", \"%s\": %.1f", figure.first, figure.second);
  std::printf("}\n");
}
