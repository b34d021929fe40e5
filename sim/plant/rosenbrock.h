#pragma once

#include <Eigen/Core>
#include <Eigen/LU>

namespace twoport::sim {

/// One step of ẏ = f(y) by RODAS (Hairer and Wanner, Solving ODEs II, IV.7): linearly implicit, fourth order, L-stable,
/// so that what decays within the step does so whatever its rate. `jacobian` is ∂f/∂y at y, f0 is f(y). Returns the
/// step's change of y; `error` is the difference to the embedded solution of third order.
template <int M, class Rate>
Eigen::Matrix<double, M, 1> rosenbrock_step(const Eigen::Matrix<double, M, M>& jacobian,
                                            const Eigen::Matrix<double, M, 1>& f0, double h, const Rate& f,
                                            Eigen::Matrix<double, M, 1>& error) noexcept {
  using Vector = Eigen::Matrix<double, M, 1>;
  constexpr double kGamma = 0.25;
  const Eigen::PartialPivLU<Eigen::Matrix<double, M, M>> lu{
      Eigen::Matrix<double, M, M>{Eigen::Matrix<double, M, M>::Identity() / (kGamma * h) - jacobian}};
  const auto solve = [&](const Vector& b) { return Vector{lu.solve(b)}; };
  const double r = 1.0 / h;
  const Vector u1 = solve(f0);
  const Vector u2 = solve(f(Vector{1.544 * u1}) - 5.6688 * r * u1);
  const Vector u3 = solve(f(Vector{0.9466785280815826 * u1 + 0.2557011698983284 * u2}) -
                          r * (2.430093356833875 * u1 + 0.2063599157091915 * u2));
  const Vector u4 = solve(f(Vector{3.314825187068521 * u1 + 2.896124015972201 * u2 + 0.9986419139977817 * u3}) -
                          r * (0.1073529058151375 * u1 + 9.594562251023355 * u2 + 20.47028614809616 * u3));
  Vector y = 1.221224509226641 * u1 + 6.019134481288629 * u2 + 12.53708332932087 * u3 - 0.6878860361058950 * u4;
  const Vector u5 = solve(
      f(y) + r * (7.496443313967647 * u1 - 10.24680431464352 * u2 - 33.99990352819905 * u3 + 11.70890893206160 * u4));
  y += u5;
  error = solve(f(y) + r * (8.083246795921522 * u1 - 7.981132988064893 * u2 - 31.52159432874371 * u3 +
                            16.31930543123136 * u4 - 6.058818238834054 * u5));
  return y + error;
}

}  // namespace twoport::sim
