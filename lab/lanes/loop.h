#pragma once

#include "lab/lanes/internal_model.h"
#include "lab/lanes/vector.h"

// The tick of a lane unit: a copy of LinkLoop (lab/engine/loops.h) with NoControl or TimeDomainPassivity, for as many simulations
// as the unit has lanes. Every operation is the laboratory's, in its order; tests/scenario/lanes_test.cc compares the results bit
// by bit. Included by a unit inside its namespace.

/// How a run is compiled: with sums for the summary (and a record where Batch::records says so), or with a record of the motion alone.
enum class Part { run, tail };

/// The coefficients of the free robot, or of the robot in contact.
static inline V of_region(M in, const V (&a)[2]) {
  return select(in, a[1], a[0]);
}

template <int N, Part kPart, LaneMethod kMethod>
struct Loop {
  using P = Parameters<V, N>;
  using S = State<V, N>;
  using T = Sums<V, N>;
  static constexpr bool kModel = kMethod == LaneMethod::internal_model,
                        kTdpa = kMethod == LaneMethod::one_port || kMethod == LaneMethod::predictive;

  Batch& b;
  const P& p;
  S& s;
  T& t;
  // Of this tick.
  V env[N], f_back[N], position_error[N], slave_energy_in, slave_dissipated, coupling_energy;
  V wanted[N], master_energy_in, master_dissipated, undissipated;

  explicit Loop(Batch& batch) : b{batch}, p{*(const P*)b.parameters}, s{*(S*)b.state}, t{*(T*)b.sums} {}

  /// ExactPlant::contact.
  M contact(const V (&n)[2]) const {
    const V depth = p.offset - n[0];
    return (depth > 0.0) & (p.wall_stiffness * depth - p.wall_damping * n[1] > 0.0);
  }

  /// Environment::force of a wall and springs.
  void force_at(const V (&x)[N], const V (&v)[N], V (&out)[N]) const {
    for (int i = 0; i < N; ++i) out[i] = V{};
    if (b.wall) {
      const V distance = dot(p.normal, x) - p.offset;
      const M inside = distance < 0.0;
      if (any(inside)) {
        const V vn = dot(p.normal, v);
        const V fn = p.wall_stiffness * -distance - p.wall_damping * vn;
        const M presses = inside & ~(fn <= 0.0);
        V along[N]{};
        if constexpr (N > 1) {
          V vt[N];
          for (int i = 0; i < N; ++i) vt[i] = v[i] - vn * p.normal[i];
          const V coulomb = p.wall_friction * fn / most(root(norm2(vt)), all(1e-3));
          for (int i = 0; i < N; ++i) along[i] = -(p.wall_viscous + coulomb) * vt[i];
        }
        for (int i = 0; i < N; ++i) out[i] = select(presses, 0.0 + (fn * p.normal[i] + along[i]), out[i]);
      }
    }
    for (int k = 0; k < b.springs; ++k)
      for (int i = 0; i < N; ++i)
        out[i] += p.spring_stiffness[k] * (p.spring_anchor[k][i] - x[i]) - p.spring_damping[k] * v[i] + 0.0;
  }
  /// step_by with Integrator::rk4: a(time, x, v, out).
  template <class A>
  void runge_kutta(V from, V (&x)[N], V (&v)[N], A a) const {
    const V h = p.step_s, half = 0.5 * h, sixth = h / 6.0;
    V xs[N], a0[N], vb[N], ab[N], vc[N], ac[N], vd[N], ad[N];
    a(from, x, v, a0);
    for (int i = 0; i < N; ++i) vb[i] = v[i] + half * a0[i], xs[i] = x[i] + half * v[i];
    a(from + half, xs, vb, ab);
    for (int i = 0; i < N; ++i) vc[i] = v[i] + half * ab[i], xs[i] = x[i] + half * vb[i];
    a(from + half, xs, vc, ac);
    for (int i = 0; i < N; ++i) vd[i] = v[i] + h * ac[i], xs[i] = x[i] + h * vc[i];
    a(from + h, xs, vd, ad);
    for (int i = 0; i < N; ++i) {
      x[i] += sixth * (v[i] + 2.0 * (vb[i] + vc[i]) + vd[i]);
      v[i] += sixth * (a0[i] + 2.0 * (ab[i] + ac[i]) + ad[i]);
    }
  }
  /// FixedStepPlant::advance.
  [[gnu::noinline]] void step_robot(M moves) {
    V x[N], v[N];
    for (int i = 0; i < N; ++i) x[i] = s.slave_x[i], v[i] = s.slave_v[i];
    for (int step = 0; step < b.substeps; ++step)
      runge_kutta(V{}, x, v, [&](V, const V(&at)[N], const V(&speed)[N], V(&out)[N]) {
        V f[N];
        force_at(at, speed, f);
        for (int i = 0; i < N; ++i) out[i] = (s.command[i] + f[i] - p.robot_damping * speed[i]) / p.robot_mass;
      });
    for (int i = 0; i < N; ++i) {
      s.slave_x[i] = select(moves, x[i], s.slave_x[i]);
      s.slave_v[i] = select(moves, v[i], s.slave_v[i]);
    }
  }
  /// HandlePlant::step_fixed: by how much the handle moves under the load u + w t, and its velocity then.
  [[gnu::noinline]] void step_handle(const V (&u)[N], const V (&w)[N], V (&by)[N], V (&v)[N]) const {
    for (int i = 0; i < N; ++i) by[i] = V{}, v[i] = s.master_v[i];
    for (int step = 0; step < b.substeps; ++step)
      runge_kutta((double)step * p.step_s, by, v, [&](V time, const V(&at)[N], const V(&speed)[N], V(&out)[N]) {
        for (int i = 0; i < N; ++i)
          out[i] =
              p.handle_inverse_mass * (u[i] + time * w[i] - p.handle_damping * speed[i] - p.hand_stiffness * at[i]);
      });
  }

  /// ExactPlant::advance.
  void advance_robot(M moves, bool first) {
    if (b.substeps > 0) return step_robot(moves);
    V u[N];
    for (int i = 0; i < N; ++i) u[i] = s.command[i] + p.pull[i];
    if (!b.wall) {
      for (int i = 0; i < N; ++i) {
        const V u0 = u[i] - p.along_stiffness[0] * s.slave_x[i];
        const V x = s.slave_x[i] + (p.along_xv[0] * s.slave_v[i] + p.along_xu[0] * u0);
        const V v = p.along_vv[0] * s.slave_v[i] + p.along_vu[0] * u0;
        s.slave_x[i] = first ? select(moves, x, s.slave_x[i]) : x;
        s.slave_v[i] = first ? select(moves, v, s.slave_v[i]) : v;
      }
      return;
    }
    const M was = s.in_contact != 0.0;
    const V pushed = dot(p.normal, u), load = pushed + of_region(was, p.load);
    const V n[2] = {s.across[0], s.across[1]};
    V to[2];
    for (int i = 0; i < 2; ++i)
      to[i] = select(was, p.map_x[1][i], p.map_x[0][i]) * n[0] +
              (select(was, p.map_v[1][i], p.map_v[0][i]) * n[1] + select(was, p.map_u[1][i], p.map_u[0][i]) * load);
    M in = contact(to);
    M apart = (of_region(was, p.in_parts) != 0.0) | (in != was) | ((~in) & (n[1] < 0.0) & (to[1] > 0.0));
    if (first) apart &= moves;
    V x[N], v[N];
    if constexpr (N == 1) {
      x[0] = to[0] * p.normal[0];
      v[0] = to[1] * p.normal[0];
    } else {
      for (int i = 0; i < N; ++i) {
        const V xt = s.slave_x[i] - n[0] * p.normal[i], vt = s.slave_v[i] - n[1] * p.normal[i];
        const V ut = u[i] - pushed * p.normal[i] - of_region(was, p.along_stiffness) * xt;
        x[i] = xt + of_region(was, p.along_xv) * vt + of_region(was, p.along_xu) * ut + to[0] * p.normal[i];
        v[i] = of_region(was, p.along_vv) * vt + of_region(was, p.along_vu) * ut + to[1] * p.normal[i];
      }
    }
    if (any(apart)) [[unlikely]]
      step_alone(bits(apart), x, v, to, in);
    for (int i = 0; i < N; ++i) {
      s.slave_x[i] = first ? select(moves, x[i], s.slave_x[i]) : x[i];
      s.slave_v[i] = first ? select(moves, v[i], s.slave_v[i]) : v[i];
    }
    for (int i = 0; i < 2; ++i) s.across[i] = first ? select(moves, to[i], n[i]) : to[i];
    s.in_contact = first ? select(moves, one_if(in), s.in_contact) : one_if(in);
  }
  /// The lanes in which contact changes, by the laboratory's plant.
  [[gnu::noinline]] void step_alone(unsigned lanes, V (&x)[N], V (&v)[N], V (&across)[2], M& in) {
    for (int lane = 0; lane < kLanes; ++lane) {
      if ((lanes >> lane & 1U) == 0) continue;
      double io[3 * N + 3];
      for (int i = 0; i < N; ++i) {
        io[i] = s.slave_x[i][lane];
        io[N + i] = s.slave_v[i][lane];
        io[2 * N + 3 + i] = s.command[i][lane];
      }
      io[2 * N] = s.across[0][lane];
      io[2 * N + 1] = s.across[1][lane];
      io[2 * N + 2] = s.in_contact[lane];
      b.plant_step(b.plant[lane], io);
      for (int i = 0; i < N; ++i) {
        x[i][lane] = io[i];
        v[i][lane] = io[N + i];
      }
      across[0][lane] = io[2 * N];
      across[1][lane] = io[2 * N + 1];
      in[lane] = io[2 * N + 2] != 0.0 ? -1 : 0;
    }
  }
  /// ExactPlant::environment_force.
  void find_environment_force() {
    if (b.substeps > 0) return force_at(s.slave_x, s.slave_v, env);
    for (int i = 0; i < N; ++i) env[i] = V{};
    if (b.wall) {
      const M in = s.in_contact != 0.0;
      if (any(in)) {
        const V depth = -(s.across[0] - p.offset);
        const V fn = p.wall_stiffness * depth - p.wall_damping * s.across[1];
        const M presses = in & ~(fn <= 0.0);
        for (int i = 0; i < N; ++i) {
          V part = fn * p.normal[i] + 0.0;
          if constexpr (N > 1) part = fn * p.normal[i] + -p.wall_viscous * (s.slave_v[i] - s.across[1] * p.normal[i]);
          env[i] = select(presses, 0.0 + part, env[i]);
        }
      }
    }
    for (int k = 0; k < b.springs; ++k)
      for (int i = 0; i < N; ++i)
        env[i] += p.spring_stiffness[k] * (p.spring_anchor[k][i] - s.slave_x[i]) - p.spring_damping[k] * s.slave_v[i];
  }

  /// Words of the packet that arrives, and whether it does: Impairment::lost.
  M arrives(int way) {
    M there = s.k >= p.lag[way];
    if (b.lossy[way]) {
      M gone = uniform(s.random[way], 2) < p.loss[way];
      if (b.bursts[way]) {
        const V state = uniform(s.random[way], 0);
        const M bad = (s.bad_state[way] != 0.0) ? (state >= p.burst_r[way]) : (state < p.burst_p[way]);
        s.bad_state[way] = select(there, one_if(bad), s.bad_state[way]);
        gone |= uniform(s.random[way], 1) < select(bad, p.burst_bad[way], p.burst_good[way]);
      }
      s.random[way] = next_packet(s.random[way]);
      there &= ~gone;
    }
    return there;
  }
  /// Words of the packets that arrive now, `words` to a slot; null where lanes have different delays.
  const V* packet(const double* ring, int way, int words) {
    if (!b.one_lag[way]) [[unlikely]]
      return nullptr;
    const std::int64_t slot = (b.clock - (std::int64_t)p.lag[way][0]) & (b.slots - 1);
    return (const V*)(ring + slot * words * kLanes);
  }
  V word(const V* from, const double* ring, int way, int words, int number) {
    return from != nullptr ? from[number] : gathered(ring, way, words, number);
  }
  [[gnu::noinline]] V gathered(const double* ring, int way, int words, int number) {
    V out{};
    for (int lane = 0; lane < kLanes; ++lane) {
      const std::int64_t slot = (b.clock - (std::int64_t)p.lag[way][lane]) & (b.slots - 1);
      out[lane] = ring[(slot * words + number) * kLanes + lane];
    }
    return out;
  }
  V& word_to_send(double* ring, int words, int number) {
    return *(V*)(ring + ((b.clock & (b.slots - 1)) * words + number) * kLanes);
  }

  /// idle -> coupled by the first packet. A run with a silence, which may change a mode, is run again alone.
  M new_mode(V& mode, M known, V heard_at, int way) {
    const V silence = (s.k - select(known, heard_at, p.lag[way])) * p.period_ns;
    s.silent = select(silence < p.most_silence_ns, s.silent, all(1.0));
    const M begins = known & (mode != 1.0);
    mode = select(known, all(1.0), mode);
    return begins;
  }

  static void book(V& absorbed, V& returned, V into) {
    absorbed += select(into > 0.0, into, V{});
    returned -= select(into < 0.0, into, V{});
  }
  V placed(V x, V origin, M shifted) {
    const V scaled = p.motion_scale * x;
    return select(shifted, p.motion_scale * (N == 1 ? x : x + 0.0) + origin, scaled);
  }
  /// Registration::to_master of a position.
  Vec<N> back(const V (&x)[N]) const {
    Vec<N> out;
    const M shifted = s.shifted != 0.0;
    for (int i = 0; i < N; ++i) {
      const V from = x[i] - s.origin[i];
      out.e[i] = select(shifted, N == 1 ? from : from + 0.0, x[i]) / p.motion_scale;
    }
    return out;
  }

  void slave_tick(bool first) {
    const M moves = s.k > 0.0;
    V before[N];
    for (int i = 0; i < N; ++i) before[i] = s.slave_x[i];
    advance_robot(moves, first);
    V moved[N];
    for (int i = 0; i < N; ++i) moved[i] = s.slave_x[i] - before[i];
    s.into_robot += dot(s.command, moved);
    coupling_energy = -(s.slave_absorbed - s.slave_returned) - s.into_robot;
    find_environment_force();
    if constexpr (kMethod == LaneMethod::nodes) return slave_nodes();
    V sensed[N];
    if (b.measured || kModel)
      for (int i = 0; i < N; ++i) sensed[i] = p.sensor_bias[i] - env[i];

    // Mailbox::collect.
    constexpr int kWords = words_to_slave(N, kMethod);
    const V* const mail = packet(b.to_slave, 0, kWords);
    const M fresh = arrives(0);
    const bool all_fresh = bits(fresh) == (1U << kLanes) - 1;
    s.received[0] += one_if(fresh);
    if (all_fresh) {
      for (int i = 0; i < N; ++i) {
        s.x_rx[i] = word(mail, b.to_slave, 0, kWords, i);
        s.v_rx[i] = word(mail, b.to_slave, 0, kWords, N + i);
      }
      s.known_energy = most(s.known_energy, word(mail, b.to_slave, 0, kWords, 2 * N));
      s.first_at[0] = select(s.master_known != 0.0, s.first_at[0], s.k);
      s.master_known = all(1.0);
      s.master_heard_at = s.k;
    } else {
      for (int i = 0; i < N; ++i) {
        s.x_rx[i] = select(fresh, word(mail, b.to_slave, 0, kWords, i), s.x_rx[i]);
        s.v_rx[i] = select(fresh, word(mail, b.to_slave, 0, kWords, N + i), s.v_rx[i]);
      }
      s.known_energy = select(fresh, most(s.known_energy, word(mail, b.to_slave, 0, kWords, 2 * N)), s.known_energy);
      s.first_at[0] = select(fresh & (s.master_known == 0.0), s.k, s.first_at[0]);
      s.master_known = select(fresh, all(1.0), s.master_known);
      s.master_heard_at = select(fresh, s.k, s.master_heard_at);
    }

    V x_rx[N];  // after what the method takes off
    for (int i = 0; i < N; ++i) x_rx[i] = s.x_rx[i];
    if constexpr (kModel) {
      constexpr int kFrom = 2 * N + 1;
      InternalModel<V, N>& m = s.model;
      for (int i = 0; i < N; ++i) {
        set(fresh, m.offset_rx[i], word(mail, b.to_slave, 0, kWords, kFrom + i));
        set(fresh, m.felt_rx[i], word(mail, b.to_slave, 0, kWords, kFrom + N + i));
      }
      set(fresh, m.informed, word(mail, b.to_slave, 0, kWords, kFrom + 2 * N));
    }

    const V was = s.slave_mode;
    M begins{};
    if (!all_fresh || any(was != 1.0)) {
      begins = new_mode(s.slave_mode, s.master_known != 0.0, s.master_heard_at, 0);
      if constexpr (kModel)
        if (any(begins)) [[unlikely]] {
          InternalModel<V, N>& m = s.model;
          set(begins, m.yield_m, V{}), set(begins, m.contact, V{}), set(begins, m.quiet_s, V{});
          set(begins, m.f_contact, Vec<N>{});
        }
    }
    if constexpr (kModel) {
      const M informed = s.model.informed != 0.0;
      for (int i = 0; i < N; ++i)
        x_rx[i] =
            select(informed, x_rx[i] + -(s.model.offset_rx[i] + s.model.yield_m * s.model.yield_normal[i]), x_rx[i]);
    }
    if (!all_fresh || any(was != 1.0)) {
      if (any(begins)) [[unlikely]] {
        M shifted{};
        for (int i = 0; i < N; ++i) {
          const V x = N == 1 ? x_rx[i] : x_rx[i] + 0.0;
          s.origin[i] = select(begins, s.slave_x[i] - p.motion_scale * x, s.origin[i]);
          shifted |= s.origin[i] != 0.0;
          s.x_sd[i] = select(begins, s.slave_x[i], s.x_sd[i]);
          s.x_d[i] = select(begins, s.slave_x[i], s.x_d[i]);
          s.x_before[i] = select(begins, s.slave_x[i], s.x_before[i]);
          s.coupling_f[i] = select(begins, V{}, s.coupling_f[i]);
        }
        s.shifted = select(begins, one_if(shifted), s.shifted);
      }
    }
    const M coupled = s.slave_mode == 1.0, active = coupled;

    if constexpr (kTdpa) {
      for (int i = 0; i < N; ++i) moved[i] = s.slave_x[i] - s.x_before[i];
      book(s.coupling_absorbed, s.coupling_returned, -dot(s.coupling_f, moved));
      for (int i = 0; i < N; ++i) s.x_before[i] = s.slave_x[i];
    }
    // VirtualCoupling::step.
    const M shifted = s.shifted != 0.0;
    V v_rx[N], v_d[N], f[N], repair[N];
    for (int i = 0; i < N; ++i) {
      v_rx[i] = select(coupled, p.motion_scale * s.v_rx[i], V{});
      const V target = select(fresh, placed(x_rx[i], s.origin[i], shifted), s.target[i] + v_rx[i] * p.dt);
      s.target[i] = select(coupled, target, s.target[i]);
      repair[i] = (s.target[i] - (b.drift_compensation ? s.x_sd[i] : s.x_d[i])) / p.dt - v_rx[i];
    }
    const V size2 = norm2(repair);
    const M large = ~(size2 <= p.catch_up * p.catch_up);
    if (any(large & coupled)) {
      const V share = select(large, p.catch_up / root(size2), all(1.0));
      for (int i = 0; i < N; ++i) repair[i] = repair[i] * share;
    }
    for (int i = 0; i < N; ++i) {
      v_d[i] = select(coupled, v_rx[i] + repair[i], V{});
      f[i] = p.stiffness * ((s.x_sd[i] + v_d[i] * p.dt) - s.slave_x[i]) + p.damping * (v_rx[i] - s.slave_v[i]);
    }
    if (any(~active)) [[unlikely]] {
      for (int i = 0; i < N; ++i) {
        f[i] = select(active, f[i], V{});
        s.x_sd[i] = select(active, s.x_sd[i], s.slave_x[i]);
        s.x_d[i] = select(active, s.x_d[i], s.slave_x[i]);
      }
    }
    for (int i = 0; i < N; ++i) f_back[i] = b.measured ? sensed[i] : f[i];
    slave_dissipated = V{};
    Vec<N> x_seen{};
    V series{};
    if constexpr (kModel) {
      InternalModel<V, N>& m = s.model;
      for (int i = 0; i < N; ++i)
        set(coupled & fresh, m.shift[i],
            placed(s.x_rx[i], s.origin[i], shifted) - placed(x_rx[i], s.origin[i], shifted));
      const Vec<N> felt = of(sensed) - of(m.bias), felt_there = p.force_scale * felt;
      const Vec<N> v_seen = p.inverse_motion * of(s.slave_v);
      set(f_back, felt);
      x_seen = back(s.slave_x);
      estimate(p, m, x_seen, v_seen, felt_there);
      const M touches = m.contact != 0.0;
      if (any(~touches)) learn_bias(p, m, ~touches, of(sensed));
      series = in_series(p, m);
      yield(p, m, coupled, felt_there, series);
      const M brakes = coupled & touches;
      if (any(brakes)) set(brakes, f, of(f) + leaving_brake(p, m, v_seen));
    }
    V v[N];
    for (int i = 0; i < N; ++i) v[i] = v_d[i];
    if constexpr (kTdpa) {
      // admittance_controller.
      const V available = p.initial_energy + p.energy_to_slave * s.known_energy - s.slave_returned;
      const V a = select(available < 0.0, V{}, available) / p.dt, power = dot(f, v_d);
      M over = ~(power <= a);
      if (any(over)) {
        V give[N], allowed_f[N], allowed_v[N];
        for (int i = 0; i < N; ++i) give[i] = p.mobility * f[i];
        const V q = dot(f, give);
        over &= ~(q < 1e-300);
        const V scale = feasible_scale(q, power - q, a);
        for (int i = 0; i < N; ++i) {
          allowed_f[i] = scale * f[i];
          allowed_v[i] = v_d[i] - (1.0 - scale) * give[i];
        }
        slave_dissipated = select(over, (power - dot(allowed_f, allowed_v)) * p.dt, V{});
        for (int i = 0; i < N; ++i) {
          f[i] = select(over, allowed_f[i], f[i]);
          v[i] = select(over, allowed_v[i], v[i]);
        }
      }
    }
    for (int i = 0; i < N; ++i) moved[i] = v[i] * p.dt;
    const V into = dot(f, moved);
    book(s.slave_absorbed, s.slave_returned, 0.0 - into);
    for (int i = 0; i < N; ++i) s.x_sd[i] += moved[i];
    if (!b.drift_compensation)
      for (int i = 0; i < N; ++i) s.x_d[i] += v_d[i] * p.dt;
    if constexpr (kTdpa) {
      book(s.coupling_absorbed, s.coupling_returned, into);
      s.coupling_worst = least(s.coupling_worst, 0.0 + (s.coupling_absorbed - s.coupling_returned));
      const V earned = s.slave_absorbed + s.coupling_worst;
      s.energy_sent = most(s.energy_sent, earned);
      slave_energy_in = s.energy_sent;
      for (int i = 0; i < N; ++i) s.coupling_f[i] = f[i];
    } else {
      slave_energy_in = s.slave_absorbed;
    }
    for (int i = 0; i < N; ++i) {
      s.command[i] = f[i];
      const V target = kModel ? s.target[i] + s.model.shift[i] : s.target[i];
      position_error[i] = select(coupled, s.slave_x[i] - target, V{});
    }
    if (any(s.slave_mode != was)) [[unlikely]] {
      const M met = (s.slave_mode != was) & coupled;
      for (int i = 0; i < N; ++i) {
        const V target = kModel ? s.target[i] + s.model.shift[i] : s.target[i];
        s.hand_origin[i] = select(met, target - p.motion_scale * s.x_rx[i], s.hand_origin[i]);
      }
    }

    constexpr int kBack = words_to_master(N, kMethod);
    for (int i = 0; i < N; ++i) {
      word_to_send(b.to_master, kBack, i) = f_back[i];
      word_to_send(b.to_master, kBack, N + i) = env[i];
      if (b.measured) word_to_send(b.to_master, kBack, 2 * N + 1 + i) = f[i];
    }
    word_to_send(b.to_master, kBack, 2 * N) = slave_energy_in;
    if constexpr (kModel) {
      const InternalModel<V, N>& m = s.model;
      const Vec<N> echo = back(s.x_sd);
      V* const to = &word_to_send(b.to_master, kBack, 3 * N + 1);
      to[0] = m.contact, to[1] = series, to[2] = m.found.friction, to[3] = m.found.curvature;
      for (int i = 0; i < N; ++i) {
        to[4 + i] = m.found.normal[i], to[4 + N + i] = m.found.point[i];
        to[4 + 2 * N + i] = echo.e[i], to[4 + 3 * N + i] = x_seen.e[i];
      }
      to[4 + 4 * N] = s.master_known;
    }
  }

  /// The slave's node, lane by lane.
  [[gnu::noinline]] void slave_nodes() {
    V io[numbers_of_slave(N)];
    for (int i = 0; i < N; ++i) {
      io[i] = s.slave_x[i];
      io[N + i] = s.slave_v[i];
      io[2 * N + i] = env[i];
    }
    for (int i = 3 * N; i < numbers_of_slave(N); ++i) io[i] = V{};
    b.slave_nodes(b, (double*)io);
    for (int i = 0; i < N; ++i) {
      s.command[i] = io[3 * N + i];
      position_error[i] = io[4 * N + i];
      s.hand_origin[i] = io[5 * N + i];
    }
    s.slave_absorbed = -io[6 * N];
    s.slave_mode = io[6 * N + 1];
    slave_dissipated = io[6 * N + 2];
  }
  [[gnu::noinline]] void master_nodes() {
    V io[numbers_of_master(N)];
    for (int i = 0; i < N; ++i) {
      io[i] = s.master_x[i];
      io[N + i] = s.master_v[i];
      io[2 * N + i] = s.held[i];
    }
    for (int i = 3 * N; i < numbers_of_master(N); ++i) io[i] = V{};
    b.master_nodes(b, (double*)io);
    for (int i = 0; i < N; ++i) {
      s.held[i] = io[2 * N + i];
      wanted[i] = io[3 * N + i];
      s.delayed_force[i] = io[4 * N + i];
    }
    s.master_absorbed = io[5 * N];
    s.master_mode = io[5 * N + 1];
    master_dissipated = io[5 * N + 2];
    undissipated = io[5 * N + 3];
  }

  void master_tick(bool first) {
    const M moves = s.k > 0.0;
    // SimDevice::advance.
    V moved[N], v[N], load[N], slope[N], by[N];
    for (int i = 0; i < N; ++i) {
      V u = -s.held[i], w{};
      if (b.hand) {
        V next;
        if constexpr (kPart == Part::tail) {
          next = p.held_at[i];
        } else if (b.together) {
          next = all(b.path[0][(std::int64_t)s.k[0] * N + i]);
        } else {
          for (int lane = 0; lane < kLanes; ++lane) next[lane] = b.path[lane][(std::int64_t)s.k[lane] * N + i];
        }
        const V rate = (next - s.intended[i]) / p.dt, stretch = s.intended[i] - s.master_x[i];
        u += p.hand_stiffness * stretch + p.hand_damping * rate;
        w = p.hand_stiffness * rate;
        s.intended[i] = first ? select(moves, next, s.intended[i]) : next;
      }
      load[i] = u, slope[i] = w;
    }
    if (b.substeps > 0) {
      step_handle(load, slope, by, v);
    } else {
      for (int i = 0; i < N; ++i) {
        by[i] = p.handle_xv * s.master_v[i] + p.handle_xu * load[i] + p.handle_xw * slope[i];
        v[i] = p.handle_vv * s.master_v[i] + p.handle_vu * load[i] + p.handle_vw * slope[i];
      }
    }
    for (int i = 0; i < N; ++i) {
      const V x = s.master_x[i] + by[i];
      moved[i] = x - s.master_x[i];
      if (first) {
        moved[i] = select(moves, moved[i], V{});
        v[i] = select(moves, v[i], s.master_v[i]);
      }
      s.master_x[i] = first ? select(moves, x, s.master_x[i]) : x;
      s.master_v[i] = v[i];
    }
    const V energy = dot(s.held, moved);
    s.master_energy += energy;
    if constexpr (kMethod == LaneMethod::nodes) return master_nodes();

    // Mailbox::collect.
    constexpr int kWords = words_to_master(N, kMethod);
    const V* const mail = packet(b.to_master, 1, kWords);
    const M fresh = arrives(1);
    const bool all_fresh = bits(fresh) == (1U << kLanes) - 1;
    s.received[1] += one_if(fresh);
    for (int i = 0; i < N; ++i) {
      s.f_rx[i] = select(fresh, word(mail, b.to_master, 1, kWords, i), s.f_rx[i]);
      if (b.measured)
        s.f_coupling_rx[i] = select(fresh, word(mail, b.to_master, 1, kWords, 2 * N + 1 + i), s.f_coupling_rx[i]);
      if constexpr (kPart == Part::run)
        s.delayed_force[i] = select(fresh, word(mail, b.to_master, 1, kWords, N + i), s.delayed_force[i]);
    }
    s.slave_energy = select(fresh, most(s.slave_energy, word(mail, b.to_master, 1, kWords, 2 * N)), s.slave_energy);
    if (any(s.slave_known == 0.0)) s.first_at[1] = select(fresh & (s.slave_known == 0.0), s.k, s.first_at[1]);
    s.slave_known = select(fresh, all(1.0), s.slave_known);
    s.slave_heard_at = select(fresh, s.k, s.slave_heard_at);
    s.force_lag = select(fresh, p.lag[1] + 1.0, s.force_lag);
    if constexpr (kModel) {
      constexpr int kFrom = 3 * N + 1;
      InternalModel<V, N>& m = s.model;
      const auto said = [&](int number, V& to) { set(fresh, to, word(mail, b.to_master, 1, kWords, kFrom + number)); };
      said(0, m.contact_rx), said(1, m.found_rx.stiffness), said(2, m.found_rx.friction), said(3, m.found_rx.curvature);
      for (int i = 0; i < N; ++i) {
        said(4 + i, m.found_rx.normal[i]), said(4 + N + i, m.found_rx.point[i]);
        said(4 + 2 * N + i, m.echo_rx[i]), said(4 + 3 * N + i, m.robot_rx[i]);
      }
      said(4 + 4 * N, m.heard);
    }

    // MasterNode::step.
    book(s.master_absorbed, s.master_returned, energy);
    if (!all_fresh || any(s.master_mode != 1.0)) {
      const M begins = new_mode(s.master_mode, s.slave_known != 0.0, s.slave_heard_at, 1);
      s.ramp = select(begins, V{}, s.ramp);
      if constexpr (kModel)
        if (any(begins)) [[unlikely]] {
          InternalModel<V, N>& m = s.model;
          set(begins, m.exists, V{}), set(begins, m.model_ramp, V{}), set(begins, m.offset_m, V{});
          set(begins, m.sticks, V{}), set(begins, m.sticks_at_echo, V{});
          set(begins, m.r, Vec<N>{}), set(begins, m.r_along, Vec<N>{});
          set(begins, m.scale_slow, all(1.0)), set(begins, m.shown, all(1.0));
        }
    }
    const M coupled = s.master_mode == 1.0, active = coupled;
    s.ramp = select(coupled & (s.ramp == 1.0), s.ramp,
                    clamp(s.ramp + select(coupled, p.ramp_by, -p.ramp_by), V{}, all(1.0)));
    if constexpr (kPart == Part::run) {
      const M old = ~fresh & ~coupled;
      if (any(old)) [[unlikely]]
        remember_force(bits(old));
    }

    if constexpr (!kModel)
      for (int i = 0; i < N; ++i) wanted[i] = select(active, s.ramp * (p.force_scale * s.f_rx[i]), V{});
    V f[N];
    master_dissipated = undissipated = V{};
    if constexpr (kModel) {
      predict(moved, moves, first);
      Vec<N> shown;
      step_internal_model(p, s, of(moved), shown, wanted, master_dissipated, undissipated);
      set(f, shown);
    } else {
      for (int i = 0; i < N; ++i) f[i] = wanted[i];
    }
    if constexpr (!kTdpa) {
      master_energy_in = s.master_absorbed;
    } else {
      // TdpaMaster::step.
      if (b.measured) book(s.command_absorbed, s.command_returned, dot(s.command_force, moved));
      if constexpr (kMethod == LaneMethod::predictive) predict(moved, moves, first);
      if (b.measured)
        for (int i = 0; i < N; ++i) s.command_force[i] = p.force_scale * s.f_coupling_rx[i];
      if (b.keeps_deficit) {
        const V put_in = s.master_absorbed - s.absorbed_before;
        s.absorbed_before = s.master_absorbed;
        const V over = (s.master_returned - s.base_returned) - (p.initial_energy + p.energy_to_master * s.slave_energy);
        const V smaller = least(put_in, over), kept = select(smaller > 0.0, smaller, V{});
        s.base_returned += kept;
        s.base_absorbed += kept;
      }
      const V reported = p.energy_to_master * s.slave_energy, absorbed = s.master_absorbed - s.base_absorbed;
      const V sendable = b.keeps_deficit ? least(reported, absorbed) : reported;
      const V available = p.initial_energy + sendable - (s.master_returned - s.base_returned);
      if constexpr (kMethod == LaneMethod::predictive) {
        control_predicted(f, available, active);
      } else {
        control_one_port(f, available, active);
      }
      master_energy_in = b.measured ? s.command_absorbed - 0.0 : absorbed;
    }
    // SafetyStage::bounded.
    const V size = root(norm2(f));
    const M beyond = ~(size <= p.most_force);
    if (any(beyond)) {
      const V share = select(beyond, p.most_force / size, all(1.0));
      for (int i = 0; i < N; ++i) f[i] = select(beyond, share * f[i], f[i]);
    }
    constexpr int kOut = words_to_slave(N, kMethod);
    for (int i = 0; i < N; ++i) {
      s.held[i] = f[i];
      word_to_send(b.to_slave, kOut, i) = s.master_x[i];
      word_to_send(b.to_slave, kOut, N + i) = s.master_v[i];
    }
    word_to_send(b.to_slave, kOut, 2 * N) = master_energy_in;
    if constexpr (kModel) {
      const InternalModel<V, N>& m = s.model;
      V* const to = &word_to_send(b.to_slave, kOut, 2 * N + 1);
      for (int i = 0; i < N; ++i) to[i] = m.offset_m * m.offset_normal[i], to[N + i] = m.felt[i];
      to[2 * N] = m.heard;
    }
  }
  /// PortVelocityPredictor::step.
  void predict(const V (&moved)[N], M moves, bool first) {
    V error[N], left[N];
    for (int i = 0; i < N; ++i) {
      const V applied = s.held[i], c = p.response;
      const V expected = s.predicted_u[i] + s.predicted_d[i] - c * (s.predicted_applied[i] + applied);
      error[i] = moved[i] / p.dt - expected;
      if (first) error[i] = select(moves, error[i], V{});
      left[i] = error[i] - 0.25 * s.predicted_before[i];
      s.predicted_before[i] = error[i];
      s.predicted_u[i] = expected + 0.75 * error[i];
      s.predicted_d[i] += 0.25 * error[i];
      s.predicted_applied[i] = applied;
      s.predicted_w[i] = s.predicted_u[i] + s.predicted_d[i] - c * applied;
    }
    s.predicted_error = most(root(norm2(error)), 0.95 * s.predicted_error);
    s.predicted_worst = most(s.predicted_error, root(norm2(left)) + p.worst_of_hand);
  }
  /// predictive_impedance_controller.
  void control_predicted(V (&f)[N], V available, M active) {
    const V deficit = select(available < 0.0, -available, V{});
    const V f2 = norm2(f);
    V response[N];
    for (int i = 0; i < N; ++i) response[i] = p.response * f[i];
    const V predicted = dot(f, s.predicted_w), power = predicted - root(f2) * s.predicted_error;
    const V q = dot(f, response);
    const M none = (f2 == 0.0);
    const V positive = select(available < 0.0, V{}, available);
    const M repays = (deficit > 0.0) & (power > 0.0);
    undissipated = select(active, deficit, V{});
    if (!any(active & ~none & (repays | ~(q - power <= positive / p.dt) | (deficit > 0.0)))) return;
    const V repaid = select(repays, least(deficit, p.most_gain * p.dt * power * power / f2), V{});
    const V scale = feasible_scale(q, -power, (positive - repaid) / p.dt);
    const V taken = scale * (power - scale * q) * p.dt;
    const V by_wanted = 1.0 * (predicted - 1.0 * q) * p.dt, by_scaled = scale * (predicted - scale * q) * p.dt;
    const V more = by_scaled - by_wanted;
    const M acts = active & ~none;
    undissipated = select(acts, deficit - clamp(taken, V{}, deficit), undissipated);
    master_dissipated = select(acts, select(more > 0.0, more, V{}), V{});
    for (int i = 0; i < N; ++i) f[i] = select(acts, scale * f[i], f[i]);
  }
  /// passivity_controller of a force: CLASSIC or FORCE_PROJECTED.
  void control_one_port(V (&f)[N], V available, M active) {
    const V power = dot(f, s.master_v), dt = p.dt;
    const V deficit = select(available < 0.0, -available, V{});
    const V loss = 0.0 - select(available < 0.0, V{}, available) - power * dt;
    const V fresh = b.predict ? select(loss > 0.0, loss, V{}) : V{};
    const V due = deficit + fresh;
    M acts = active & ~(due == 0.0);
    if (!any(acts)) return;
    const V in2 = norm2(s.master_v);
    const M slow = in2 < 1e-24;
    undissipated = select(acts & slow, due, V{});
    acts &= ~slow;
    if (!b.projected) {
      const V per_gain = in2 * dt, repaid = least(deficit, p.most_gain * per_gain);
      const V gain = (fresh + repaid) / per_gain;
      for (int i = 0; i < N; ++i) f[i] = select(acts, f[i] + gain * s.master_v[i], f[i]);
      master_dissipated = select(acts, fresh + repaid, V{});
      undissipated = select(acts, deficit - repaid, undissipated);
      return;
    }
    const V out2 = norm2(f);
    const M across = (out2 < 1e-24) | (power * power < 1e-20 * in2 * out2);
    undissipated = select(acts & across, due, undissipated);
    acts &= ~across;
    const V repaid = least(deficit, p.most_gain * dt * power * power / out2);
    V scale = 1.0 + (fresh + repaid) / (dt * power);
    if (b.unilateral) scale = select(scale < 0.0, V{}, scale);
    const V taken = (scale - 1.0) * power * dt, left = due - taken;
    master_dissipated = select(acts, taken, V{});
    undissipated = select(acts, select(left > 0.0, left, V{}), undissipated);
    for (int i = 0; i < N; ++i) f[i] = select(acts, scale * f[i], f[i]);
  }
  /// DelayedForce: while nothing is heard the environment's force goes on, as old as it was.
  [[gnu::noinline]] void remember_force(unsigned lanes) {
    constexpr int kWords = words_to_master(N, kMethod);
    for (int lane = 0; lane < kLanes; ++lane) {
      if ((lanes >> lane & 1U) == 0) continue;
      const double lag = s.force_lag[lane];
      const std::int64_t slot = (b.clock - ((std::int64_t)lag - 1)) & (b.slots - 1);
      for (int i = 0; i < N; ++i)
        s.delayed_force[i][lane] = s.k[lane] + 1.0 >= lag ? b.to_master[(slot * kWords + N + i) * kLanes + lane] : 0.0;
    }
  }

  [[gnu::noinline]] V squared_angle(unsigned lanes, const V (&u)[N], const V (&f)[N], V u2, V f2) {
    V out{};
    for (int lane = 0; lane < kLanes; ++lane) {
      if ((lanes >> lane & 1U) == 0) continue;
      double u1[N], f1[N];
      for (int i = 0; i < N; ++i) u1[i] = u[i][lane], f1[i] = f[i][lane];
      out[lane] = b.squared_angle(u1, f1, u2[lane], f2[lane]);
    }
    return out;
  }
  V angle2(M of, const V (&u)[N], const V (&f)[N], V u2, V f2) {
    const V along = dot(u, f);
    if constexpr (N == 1) {
      return select(of & (along < 0.0), all(3.14159265358979323846 * 3.14159265358979323846), V{});
    } else {
      const V share = along / f2, across2 = u2 - along * share;
      const M small = (along > 0.0) & (across2 < 1e-14 * u2);
      V off[N];
      for (int i = 0; i < N; ++i) off[i] = u[i] - share * f[i];
      V out = select(small, norm2(off) / u2, V{});
      const M large = of & ~small;
      if (any(large)) out = select(large, squared_angle(bits(large), u, f, u2, f2), out);
      return out;
    }
  }
  static void lower(V& low, V value) { low = select(value < low, value, low); }
  static void raise(V& high, V value) { high = select(value > high, value, high); }
  static void count(V& n, M when) { n += one_if(when); }

  /// Metrics::add, ContactFigures::add, HeldForce::add, RunJudge::add and Contacts::add of lab/run.cc. Returns the lanes that have diverged.
  unsigned add_sums() {
    const M following = s.slave_mode == 1.0, coupled = following & (s.master_mode == 1.0);
    const V slave_energy = -(s.slave_absorbed - s.slave_returned);
    const V dissipated = master_dissipated + (0.0 + p.energy_to_master * slave_dissipated);
    lower(t.min_energy, s.master_energy);
    lower(t.min_observed, s.master_absorbed - s.master_returned);
    lower(t.min_two_port, s.master_energy - p.energy_to_master * slave_energy);
    lower(t.min_robot, coupling_energy);
    raise(t.robot_force2, norm2(s.command));
    const V slave_speed2 = norm2(s.slave_v);
    raise(t.robot_speed2, slave_speed2);
    raise(t.owed, undissipated);
    t.dissipated += dissipated;
    count(t.corrected_ticks, dissipated > 0.0);
    t.drift2 = norm2(position_error);
    t.position_error2 += t.drift2;
    if (any(~following)) [[unlikely]] {
      count(t.apart_rows, ~following);
      t.last_apart_row = select(following, t.last_apart_row, s.k + 1.0);
    }

    V correction[N], fast[N];
    for (int i = 0; i < N; ++i) correction[i] = s.held[i] - wanted[i];
    const V correction2 = norm2(correction), felt2 = norm2(s.held), wanted2 = norm2(wanted);
    t.force_error2 += correction2;
    raise(t.correction2, correction2);
    raise(t.force2, felt2);
    for (int i = 0; i < N; ++i) {
      const V x = s.held[i], y = p.filter_b0 * x + t.filter_1[i];
      t.filter_1[i] = -2.0 * p.filter_b0 * x - p.filter_a1 * y + t.filter_2[i];
      t.filter_2[i] = p.filter_b0 * x - p.filter_a2 * y;
      fast[i] = y;
    }
    t.chatter2 += norm2(fast);
    constexpr double kFelt2 = 0.05 * 0.05;
    const M is_wanted = wanted2 > kFelt2, compared = is_wanted & (felt2 > kFelt2);
    count(t.wanted_rows, is_wanted);
    count(t.turned_rows, compared);
    const M turns = compared & (correction2 != 0.0);
    if (any(turns)) {
      const V turn2 = angle2(turns, s.held, wanted, felt2, wanted2);
      t.turn2_max = select(turns & (turn2 > t.turn2_max), turn2, t.turn2_max);
      t.turn2 += select(turns, turn2, V{});
    }

    // Contact.
    count(t.uncoupled, ~coupled);
    V reference[N];
    for (int i = 0; i < N; ++i) reference[i] = p.force_scale * -s.delayed_force[i];
    const V reference2 = norm2(reference), env2 = norm2(env);
    const M touching = b.springs > 0 ? ~M{} : env2 > 0.0;
    const M free = ~touching & coupled & (reference2 == 0.0);
    count(t.free, free);
    t.free_force2 += select(free, felt2, V{});
    const M held = touching & (p.at_rest != 0.0);
    if (any(~held & (t.held_ticks != 0.0))) [[unlikely]] {
      const unsigned ended = bits(~held & (t.held_ticks >= p.window));
      for (int lane = 0; lane < kLanes; ++lane)
        if ((ended >> lane & 1U) != 0) b.window_ended(b, lane);
      t.held_ticks = select(held, t.held_ticks, V{});
    }
    if (any(touching)) {
      count(t.touching, touching);
      const V size = N == 1 ? absolute(env[0]) : root(env2);
      t.environment_force += select(touching, size, V{});
      V off[N], ahead[N];
      for (int i = 0; i < N; ++i) off[i] = s.held[i] - reference[i];
      t.error2 += select(touching, norm2(off), V{});
      const M both = touching & (felt2 > kFelt2) & (reference2 > kFelt2);
      if (any(both)) {
        count(t.compared, both);
        t.contact_turn2 += select(both, angle2(both, s.held, reference, felt2, reference2), V{});
      }
      constexpr double kLoud2 = 0.2 * 0.2, kMuted2 = 0.1 * 0.1;
      const M quiet = touching & (reference2 <= kLoud2);
      count(t.quiet, quiet);
      count(t.muted, touching & ~quiet & (felt2 < kMuted2 * reference2));
      for (int i = 0; i < N; ++i) {
        const V d = p.motion_scale * s.master_x[i] + s.hand_origin[i] - s.slave_x[i];
        ahead[i] = select(following, d, V{});
      }
      const V behind = -dot(env, ahead);
      const M deeper = touching & (behind > 0.0) & (behind * behind > t.penetration2 * env2);
      t.penetration2 = select(deeper, behind * behind / env2, t.penetration2);
      if (any(held)) {
        double* const row = b.window + (b.clock & (b.window_slots - 1)) * 2 * N * kLanes;
        for (int i = 0; i < N; ++i) {
          *(V*)(row + i * kLanes) = s.held[i];
          *(V*)(row + (N + i) * kLanes) = reference[i];
        }
        const V next = t.held_next + 1.0;
        t.held_next = select(held, select(next == p.window, V{}, next), t.held_next);
        count(t.held_ticks, held);
      }
    }

    // RunJudge::add.
    const V speed2 = norm2(s.master_v) + slave_speed2;
    const V of_master = norm2(s.master_x), of_slave = norm2(s.slave_x), reach2 = most(of_master, of_slave);
    const V sum = reach2 + s.master_energy;
    const M diverged = ~(speed2 <= p.most_speed2) | ~(sum - sum == 0.0);
    raise(t.reach2, reach2);
    for (int i = 0; i < N; ++i) {
      raise(t.speed[i], absolute(s.master_v[i]));
      raise(t.speed[N + i], absolute(s.slave_v[i]));
    }
    t.was_coupled = select(s.master_mode == 1.0, all(1.0), t.was_coupled);
    t.apart_at_end = select(coupled, V{}, t.apart_at_end + 1.0);

    // Contacts::add.
    const M pressed = env2 != 0.0;
    if (b.keeps_states && any(pressed)) {
      t.pressed += select(pressed, root(env2), V{});
      const M seen = pressed & (p.late != 0.0);
      if (b.wall && any(seen)) {
        const M looks = seen & (t.late_ticks == 0.0);
        const V next = t.late_ticks + 1.0;
        t.late_ticks = select(seen, select(next == 8.0, V{}, next), t.late_ticks);
        if (any(looks)) t.touched = select(looks & (dot(p.normal, s.slave_x) - p.offset < 0.0), all(1.0), t.touched);
      }
    }
    return bits(diverged);
  }

  /// The row that quiet_tail.cc sees.
  void add_record() {
    constexpr int kWords = words_of_record(N);
    V* const row = (V*)(b.record + b.record_row * kWords * kLanes);
    const V slave_energy = -(s.slave_absorbed - s.slave_returned);
    const V dissipated = master_dissipated + (0.0 + p.energy_to_master * slave_dissipated);
    for (int i = 0; i < N; ++i) {
      row[i] = s.master_v[i];
      row[N + i] = s.slave_v[i];
    }
    row[2 * N] = s.master_energy;
    row[2 * N + 1] = s.master_energy - p.energy_to_master * slave_energy;
    const V felt2 = norm2(s.held), wanted2 = norm2(wanted), f2 = norm2(s.command), env2 = norm2(env);
    const M limited = (dissipated == 0.0) & (felt2 < wanted2 * (1.0 - 1e-9));
    const M driven = (felt2 > 0.0) | (f2 > 0.0);
    row[2 * N + 2] = coupling_energy;
    row[2 * N + 3] = slave_energy - coupling_energy;
    row[2 * N + 4] = one_if(env2 > 0.0) * (double)kTouching + one_if(limited) * (double)kLimited +
                     one_if(dissipated > 0.0) * (double)kActed + one_if(driven) * (double)kDriven +
                     one_if(s.silent != 0.0) * (double)kSilent;
    ++b.record_row;
  }

  unsigned tick(bool first) {
    slave_tick(first);
    master_tick(first);
    unsigned diverged = 0;
    if constexpr (kPart == Part::run) {
      diverged = add_sums();
      if (b.records) add_record();
    } else {
      add_record();
    }
    s.k += 1.0;
    ++b.clock;
    return diverged;
  }
  /// A tick in which a lane's first one may be.
  [[gnu::noinline]] unsigned first_tick() { return tick(true); }
};

// Every call in it inlined: FORCE_PROJECTED is then 7 % faster.
template <int N, Part kPart, LaneMethod kMethod>
[[gnu::flatten]] static std::int64_t run_ticks(Batch& b, std::int64_t ticks) {
  Loop<N, kPart, kMethod> loop{b};
  b.diverged = 0;
  for (std::int64_t i = 0; i < ticks; ++i) {
    const bool first = kPart == Part::run && i == 0 && any(loop.s.k == 0.0);
    const unsigned diverged = first ? loop.first_tick() : loop.tick(false);
    if (diverged != 0) {
      b.diverged = diverged;
      return i + 1;
    }
  }
  return ticks;
}
template <int N, Part kPart>
static std::int64_t run_method(Batch& b, std::int64_t ticks) {
  switch (b.method) {
    case LaneMethod::none:
      return run_ticks<N, kPart, LaneMethod::none>(b, ticks);
    case LaneMethod::one_port:
      return run_ticks<N, kPart, LaneMethod::one_port>(b, ticks);
    case LaneMethod::predictive:
      return run_ticks<N, kPart, LaneMethod::predictive>(b, ticks);
    case LaneMethod::internal_model:
      return run_ticks<N, kPart, LaneMethod::internal_model>(b, ticks);
    default:
      return run_ticks<N, kPart, LaneMethod::nodes>(b, ticks);
  }
}
