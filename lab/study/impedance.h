#pragma once

#include <string>
#include <vector>

#include "common/scene/scene.h"

namespace twoport::lab {

struct ImpedanceOptions {
  double amplitude_m = 1e-3;  ///< largest excursion; less where contact would end or begin
  double low_hz = 0.5;        ///< lines are odd multiples of it
  double high_hz = 50.0;
  int lines = 20;
  int realizations = 8;  ///< runs with other phases, every second one of half the amplitude
  int periods = 2;       ///< in each, of 1/low_hz, after one that is left out
};

/// m, b, k of a dynamic stiffness S(jω) = k - m ω² + jω b, along one direction.
struct MassDamperSpring {
  double mass_kg = 0.0, damping_n_s_per_m = 0.0, stiffness_n_per_m = 0.0;
};
/// At one frequency.
struct ImpedanceLine {
  double frequency_hz;
  double displayed_re, displayed_im;  ///< F/X [N/m]
  double true_re, true_im;
  double coherence;  ///< γ² = |Σ X*F|² / (Σ|X|² Σ|F|²); 0: a force that does not follow the motion; NaN: no force
};
/// In one place.
struct DisplayedImpedance {
  std::string place;  ///< "free space" or "contact"
  double amplitude_m = 0.0;
  MassDamperSpring displayed, truth;
  double least_coherence = 0.0;  ///< of the lines that the fit is over
  std::vector<ImpedanceLine> lines;
};

/// The impedance that the hand feels: force against motion at the master port, along the direction in which the environment
/// pushes.
///
/// The scene is run to find where the robot (device under RENDER) touches. Then the handle is moved to that place, and to free
/// space, and excited by a multi-sine of constant speed amplitude: odd lines, random phases, whole periods. Sums over all
/// periods of all realizations give for each line the best linear approximation and its coherence:
///
///     F/X = Σ X*F / Σ|X|²        γ² = |Σ X*F|² / (Σ|X|² Σ|F|²)
///
/// X, F: spectra of position and force in one period. A linear loop has γ² = 1. Noise and lost packets lower it, as they differ
/// from period to period; nonlinearity lowers it, as the lines that it mixes into a line carry other phases, and another gain
/// at the other amplitude, in each realization.
/// Source: Pintelon, Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley 2012, chapters 3 and 4
/// (random-phase multisine, best linear approximation, robust method).
///
/// The force is held between ticks of T: its spectrum is that of the samples times e^{-jωT/2} sinc(ωT/2). The truth is the
/// robot's mass and damping and the environment's slopes, all times force_scale · motion_scale. Displayed m, b, k are a
/// least-squares fit of relative errors over the lines up to 10 Hz, the bandwidth of a hand.
///
/// A spring K rendered on the device so displays K sinc(ωT/2) and the damping -KT/2.
///
/// Throws ConfigError with one sentence where there is no master port, the sides are never coupled, the scene is unstable, or
/// a place is too close to the surface to be measured.
std::vector<DisplayedImpedance> displayed_impedance(const Scene& scene, const ImpedanceOptions& options = {});

std::string to_csv(const std::vector<DisplayedImpedance>& all);
/// A table for people.
std::string to_text(const std::vector<DisplayedImpedance>& all);

}  // namespace twoport::lab
