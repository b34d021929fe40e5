#pragma once

#include "common/base/sanitized.h"
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
  using Vector = Vec<N>;
  static constexpr bool kModel = kMethod == LaneMethod::internal_model,
                        kTdpa = kMethod == LaneMethod::one_port || kMethod == LaneMethod::predictive;

  Batch& b;
  const P& p;
  S& s;
  T& t;
  // Of this tick.
  Vector env, f_back, position_error, wanted;
  V slave_energy_in, slave_dissipated, coupling_energy, master_energy_in, master_dissipated, undissipated;

  explicit Loop(Batch& batch) : b{batch}, p{*(const P*)b.parameters}, s{*(S*)b.state}, t{*(T*)b.sums} {}

  /// Where m, or everywhere unless this is a lane's first tick.
  static void put(bool first, M m, Vector& to, const Vector& a) { to = first ? select(m, a, to) : a; }

  /// ExactPlant::contact.
  M contact(const V (&n)[2]) const {
    const V depth = p.offset - n[0];
    return (depth > 0.0) & (p.wall_stiffness * depth - p.wall_damping * n[1] > 0.0);
  }

  /// Environment::force of a wall and springs.
  Vector force_at(const Vector& x, const Vector& v) const {
    Vector out{};
    if (b.wall) {
      const V distance = dot(p.normal, x) - p.offset;
      const M inside = distance < 0.0;
      if (any(inside)) {
        const V vn = dot(p.normal, v);
        const V fn = p.wall_stiffness * -distance - p.wall_damping * vn;
        Vector along{};
        if constexpr (N > 1) {
          const Vector vt = v - vn * p.normal;
          const V coulomb = p.wall_friction * fn / most(root(norm2(vt)), all(1e-3));
          along = -(p.wall_viscous + coulomb) * vt;
        }
        set(inside & ~(fn <= 0.0), out, (fn * p.normal + along) + 0.0);
      }
    }
    for (int k = 0; k < b.springs; ++k)
      out += (p.spring_stiffness[k] * (p.spring_anchor[k] - x) - p.spring_damping[k] * v) + 0.0;
    return out;
  }
  /// step_by with Integrator::rk4: a(time, x, v).
  template <class A>
  void runge_kutta(V from, Vector& x, Vector& v, A a) const {
    const V h = p.step_s, half = 0.5 * h, sixth = h / 6.0, two = all(2.0);
    const Vector a0 = a(from, x, v);
    const Vector vb = v + half * a0, ab = a(from + half, x + half * v, vb);
    const Vector vc = v + half * ab, ac = a(from + half, x + half * vb, vc);
    const Vector vd = v + h * ac, ad = a(from + h, x + h * vc, vd);
    x += sixth * (v + two * (vb + vc) + vd);
    v += sixth * (a0 + two * (ab + ac) + ad);
  }
  /// FixedStepPlant::advance.
  void step_robot(M moves) {
    Vector x = s.slave_x, v = s.slave_v;
    for (int step = 0; step < b.substeps; ++step)
      runge_kutta(V{}, x, v, [&](V, const Vector& at, const Vector& speed) {
        return (s.command + force_at(at, speed) - p.robot_damping * speed) / p.robot_mass;
      });
    set(moves, s.slave_x, x);
    set(moves, s.slave_v, v);
  }
  /// HandlePlant::step_fixed: by how much the handle moves under the load u + w t, and its velocity then.
  void step_handle(const Vector& u, const Vector& w, Vector& by, Vector& v) const {
    by = Vector{}, v = s.master_v;
    for (int step = 0; step < b.substeps; ++step)
      runge_kutta((double)step * p.step_s, by, v, [&](V time, const Vector& at, const Vector& speed) {
        return p.handle_inverse_mass * (u + time * w - p.handle_damping * speed - p.hand_stiffness * at);
      });
  }

  /// ExactPlant::advance.
  void advance_robot(M moves, bool first) {
    if (b.substeps > 0) return step_robot(moves);
    const Vector u = s.command + p.pull;
    Vector x, v;
    if (!b.wall) {
      const Vector u0 = u - p.along_stiffness[0] * s.slave_x;
      x = s.slave_x + (p.along_xv[0] * s.slave_v + p.along_xu[0] * u0);
      v = p.along_vv[0] * s.slave_v + p.along_vu[0] * u0;
    } else {
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
      if constexpr (N == 1) {
        x = to[0] * p.normal;
        v = to[1] * p.normal;
      } else {
        const Vector xt = s.slave_x - n[0] * p.normal, vt = s.slave_v - n[1] * p.normal;
        const Vector ut = u - pushed * p.normal - of_region(was, p.along_stiffness) * xt;
        x = xt + of_region(was, p.along_xv) * vt + of_region(was, p.along_xu) * ut + to[0] * p.normal;
        v = of_region(was, p.along_vv) * vt + of_region(was, p.along_vu) * ut + to[1] * p.normal;
      }
      if (any(apart)) [[unlikely]]
        step_alone(bits(apart), x, v, to, in);
      for (int i = 0; i < 2; ++i) s.across[i] = first ? select(moves, to[i], n[i]) : to[i];
      s.in_contact = first ? select(moves, one_if(in), s.in_contact) : one_if(in);
    }
    put(first, moves, s.slave_x, x);
    put(first, moves, s.slave_v, v);
  }
  /// The lanes in which contact changes, by the laboratory's plant.
  void step_alone(unsigned lanes, Vector& x, Vector& v, V (&across)[2], M& in) {
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
      for (int i = 0; i < N; ++i) x[i][lane] = io[i], v[i][lane] = io[N + i];
      across[0][lane] = io[2 * N];
      across[1][lane] = io[2 * N + 1];
      in[lane] = io[2 * N + 2] != 0.0 ? -1 : 0;
    }
  }
  /// ExactPlant::environment_force.
  void find_environment_force() {
    env = Vector{};
    if (b.substeps > 0) {
      env = force_at(s.slave_x, s.slave_v);
      return;
    }
    if (b.wall) {
      const M in = s.in_contact != 0.0;
      if (any(in)) {
        const V depth = -(s.across[0] - p.offset);
        const V fn = p.wall_stiffness * depth - p.wall_damping * s.across[1];
        Vector part = fn * p.normal + 0.0;
        if constexpr (N > 1) part = fn * p.normal + -p.wall_viscous * (s.slave_v - s.across[1] * p.normal);
        set(in & ~(fn <= 0.0), env, part + 0.0);
      }
    }
    for (int k = 0; k < b.springs; ++k)
      env += p.spring_stiffness[k] * (p.spring_anchor[k] - s.slave_x) - p.spring_damping[k] * s.slave_v;
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
  /// Words of the packets of one direction that arrive now.
  struct Ring {
    const Loop& loop;
    const double* ring;
    int way, words;  ///< in a slot
    const V* mail;   ///< null where lanes have different delays

    Ring(const Loop& of, const double* memory, int of_way, int count)
        : loop{of}, ring{memory}, way{of_way}, words{count} {
      const std::int64_t slot = (of.b.clock - (std::int64_t)of.p.lag[way][0]) & (of.b.slots - 1);
      mail = of.b.one_lag[way] ? (const V*)(ring + slot * words * kLanes) : nullptr;
    }
    V operator[](int number) const { return mail != nullptr ? mail[number] : loop.gathered(ring, way, words, number); }
    Vector vector(int from) const {
      Vector out;
      for (int i = 0; i < N; ++i) out[i] = (*this)[from + i];
      return out;
    }
  };
  V gathered(const double* ring, int way, int words, int number) const {
    V out{};
    for (int lane = 0; lane < kLanes; ++lane) {
      const std::int64_t slot = (b.clock - (std::int64_t)p.lag[way][lane]) & (b.slots - 1);
      out[lane] = ring[(slot * words + number) * kLanes + lane];
    }
    return out;
  }
  /// Words of a packet to send.
  V* to_send(double* ring, int words) const { return (V*)(ring + (b.clock & (b.slots - 1)) * words * kLanes); }
  static void write(V* to, const Vector& a) {
    for (int i = 0; i < N; ++i) to[i] = a[i];
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
  Vector placed(const Vector& x) const {
    return select(s.shifted != 0.0, p.motion_scale * (N == 1 ? x : x + 0.0) + s.origin, p.motion_scale * x);
  }
  /// Registration::to_master of a position.
  Vector back(const Vector& x) const {
    const Vector from = x - s.origin;
    return select(s.shifted != 0.0, N == 1 ? from : from + 0.0, x) / p.motion_scale;
  }

  void slave_tick(bool first) {
    const M moves = s.k > 0.0;
    const Vector before = s.slave_x;
    advance_robot(moves, first);
    s.into_robot += dot(s.command, s.slave_x - before);
    coupling_energy = -(s.slave_absorbed - s.slave_returned) - s.into_robot;
    find_environment_force();
    if constexpr (kMethod == LaneMethod::nodes) return slave_nodes();
    Vector sensed{};
    if (b.measured || kModel) sensed = p.sensor_bias - env;

    // Mailbox::collect.
    const Ring mail{*this, b.to_slave, 0, words_to_slave(N, kMethod)};
    const M fresh = arrives(0);
    const bool all_fresh = bits(fresh) == (1U << kLanes) - 1;
    s.received[0] += one_if(fresh);
    if (all_fresh) {
      s.x_rx = mail.vector(0);
      s.v_rx = mail.vector(N);
      s.known_energy = most(s.known_energy, mail[2 * N]);
      s.first_at[0] = select(s.master_known != 0.0, s.first_at[0], s.k);
      s.master_known = all(1.0);
      s.master_heard_at = s.k;
    } else {
      set(fresh, s.x_rx, mail.vector(0));
      set(fresh, s.v_rx, mail.vector(N));
      set(fresh, s.known_energy, most(s.known_energy, mail[2 * N]));
      set(fresh & (s.master_known == 0.0), s.first_at[0], s.k);
      set(fresh, s.master_known, all(1.0));
      set(fresh, s.master_heard_at, s.k);
    }

    Vector x_rx = s.x_rx;  // after what the method takes off
    if constexpr (kModel) {
      InternalModel<V, N>& m = s.model;
      set(fresh, m.offset_rx, mail.vector(2 * N + 1));
      set(fresh, m.felt_rx, mail.vector(3 * N + 1));
      set(fresh, m.informed, mail[4 * N + 1]);
    }

    const V was = s.slave_mode;
    M begins{};
    if (!all_fresh || any(was != 1.0)) {
      begins = new_mode(s.slave_mode, s.master_known != 0.0, s.master_heard_at, 0);
      if constexpr (kModel)
        if (any(begins)) [[unlikely]] {
          InternalModel<V, N>& m = s.model;
          set(begins, m.yield_m, V{}), set(begins, m.contact, V{}), set(begins, m.quiet_s, V{});
          set(begins, m.f_contact, Vector{});
        }
    }
    if constexpr (kModel)
      set(s.model.informed != 0.0, x_rx, x_rx + -(s.model.offset_rx + s.model.yield_m * s.model.yield_normal));
    if (any(begins)) [[unlikely]] {
      set(begins, s.origin, s.slave_x - p.motion_scale * (N == 1 ? x_rx : x_rx + 0.0));
      M shifted{};
      for (int i = 0; i < N; ++i) shifted |= s.origin[i] != 0.0;
      set(begins, s.x_sd, s.slave_x), set(begins, s.x_d, s.slave_x), set(begins, s.x_before, s.slave_x);
      set(begins, s.coupling_f, Vector{});
      set(begins, s.shifted, one_if(shifted));
    }
    const M coupled = s.slave_mode == 1.0, active = coupled;

    if constexpr (kTdpa) {
      book(s.coupling_absorbed, s.coupling_returned, -dot(s.coupling_f, s.slave_x - s.x_before));
      s.x_before = s.slave_x;
    }
    // VirtualCoupling::step.
    const Vector v_rx = select(coupled, p.motion_scale * s.v_rx, Vector{});
    set(coupled, s.target, select(fresh, placed(x_rx), s.target + p.dt * v_rx));
    Vector repair = (s.target - (b.drift_compensation ? s.x_sd : s.x_d)) / p.dt - v_rx;
    const V size2 = norm2(repair);
    const M large = ~(size2 <= p.catch_up * p.catch_up);
    if (any(large & coupled)) repair = select(large, p.catch_up / root(size2), all(1.0)) * repair;
    const Vector v_d = select(coupled, v_rx + repair, Vector{});
    Vector f = p.stiffness * ((s.x_sd + p.dt * v_d) - s.slave_x) + p.damping * (v_rx - s.slave_v);
    if (any(~active)) [[unlikely]] {
      set(~active, f, Vector{});
      set(~active, s.x_sd, s.slave_x);
      set(~active, s.x_d, s.slave_x);
    }
    f_back = b.measured ? sensed : f;
    slave_dissipated = V{};
    Vector x_seen{};
    V series{};
    if constexpr (kModel) {
      InternalModel<V, N>& m = s.model;
      set(coupled & fresh, m.shift, placed(s.x_rx) - placed(x_rx));
      const Vector felt = sensed - m.bias, felt_there = p.force_scale * felt;
      const Vector v_seen = p.inverse_motion * s.slave_v;
      f_back = felt;
      x_seen = back(s.slave_x);
      estimate(p, m, x_seen, v_seen, felt_there);
      const M touches = m.contact != 0.0;
      if (any(~touches)) learn_bias(p, m, ~touches, sensed);
      series = in_series(p, m);
      yield(p, m, coupled, felt_there, series);
      const M brakes = coupled & touches;
      if (any(brakes)) set(brakes, f, f + leaving_brake(p, m, v_seen));
    }
    Vector v = v_d;
    if constexpr (kTdpa) {
      // admittance_controller.
      const V available = p.initial_energy + p.energy_to_slave * s.known_energy - s.slave_returned;
      const V a = select(available < 0.0, V{}, available) / p.dt, power = dot(f, v_d);
      M over = ~(power <= a);
      if (any(over)) {
        const Vector give = p.mobility * f;
        const V q = dot(f, give);
        over &= ~(q < 1e-300);
        const V scale = feasible_scale(q, power - q, a);
        const Vector allowed_f = scale * f, allowed_v = v_d - (1.0 - scale) * give;
        slave_dissipated = select(over, (power - dot(allowed_f, allowed_v)) * p.dt, V{});
        set(over, f, allowed_f);
        set(over, v, allowed_v);
      }
    }
    const Vector moved = p.dt * v;
    const V into = dot(f, moved);
    book(s.slave_absorbed, s.slave_returned, 0.0 - into);
    s.x_sd += moved;
    if (!b.drift_compensation) s.x_d += p.dt * v_d;
    if constexpr (kTdpa) {
      book(s.coupling_absorbed, s.coupling_returned, into);
      s.coupling_worst = least(s.coupling_worst, 0.0 + (s.coupling_absorbed - s.coupling_returned));
      const V earned = s.slave_absorbed + s.coupling_worst;
      s.energy_sent = most(s.energy_sent, earned);
      slave_energy_in = s.energy_sent;
      s.coupling_f = f;
    } else {
      slave_energy_in = s.slave_absorbed;
    }
    s.command = f;
    Vector target = s.target;
    if constexpr (kModel) target = s.target + s.model.shift;
    position_error = select(coupled, s.slave_x - target, Vector{});
    if (any(s.slave_mode != was)) [[unlikely]]
      set((s.slave_mode != was) & coupled, s.hand_origin, target - p.motion_scale * s.x_rx);

    V* const to = to_send(b.to_master, words_to_master(N, kMethod));
    write(to, f_back);
    write(to + N, env);
    to[2 * N] = slave_energy_in;
    if (b.measured) write(to + 2 * N + 1, f);
    if constexpr (kModel) {
      const InternalModel<V, N>& m = s.model;
      V* const said = to + 3 * N + 1;
      said[0] = m.contact, said[1] = series, said[2] = m.found.friction, said[3] = m.found.curvature;
      write(said + 4, m.found.normal);
      write(said + 4 + N, m.found.point);
      write(said + 4 + 2 * N, back(s.x_sd));
      write(said + 4 + 3 * N, x_seen);
      said[4 + 4 * N] = s.master_known;
    }
  }

  /// The slave's node, lane by lane.
  void slave_nodes() {
    V io[numbers_of_slave(N)]{};
    write(io, s.slave_x);
    write(io + N, s.slave_v);
    write(io + 2 * N, env);
    b.slave_nodes(b, (double*)io);
    s.command = vector_at<N>(io + 3 * N);
    position_error = vector_at<N>(io + 4 * N);
    s.hand_origin = vector_at<N>(io + 5 * N);
    s.slave_absorbed = -io[6 * N];
    s.slave_mode = io[6 * N + 1];
    slave_dissipated = io[6 * N + 2];
  }
  void master_nodes() {
    V io[numbers_of_master(N)]{};
    write(io, s.master_x);
    write(io + N, s.master_v);
    write(io + 2 * N, s.held);
    b.master_nodes(b, (double*)io);
    s.held = vector_at<N>(io + 2 * N);
    wanted = vector_at<N>(io + 3 * N);
    s.delayed_force = vector_at<N>(io + 4 * N);
    s.master_absorbed = io[5 * N];
    s.master_mode = io[5 * N + 1];
    master_dissipated = io[5 * N + 2];
    undissipated = io[5 * N + 3];
  }

  /// The hand's intended position at the end of this tick.
  Vector intended() const {
    if constexpr (kPart == Part::tail) return p.held_at;
    Vector next;
    for (int i = 0; i < N; ++i) {
      if (b.together) {
        next[i] = all(b.path[0][(std::int64_t)s.k[0] * N + i]);
      } else {
        for (int lane = 0; lane < kLanes; ++lane) next[i][lane] = b.path[lane][(std::int64_t)s.k[lane] * N + i];
      }
    }
    return next;
  }

  void master_tick(bool first) {
    const M moves = s.k > 0.0;
    // SimDevice::advance.
    Vector load = -s.held, slope{}, by, v;
    if (b.hand) {
      const Vector next = intended();
      const Vector rate = (next - s.intended) / p.dt, stretch = s.intended - s.master_x;
      load += p.hand_stiffness * stretch + p.hand_damping * rate;
      slope = p.hand_stiffness * rate;
      put(first, moves, s.intended, next);
    }
    if (b.substeps > 0) {
      step_handle(load, slope, by, v);
    } else {
      by = p.handle_xv * s.master_v + p.handle_xu * load + p.handle_xw * slope;
      v = p.handle_vv * s.master_v + p.handle_vu * load + p.handle_vw * slope;
    }
    const Vector x = s.master_x + by;
    Vector moved = x - s.master_x;
    if (first) set(~moves, moved, Vector{});
    put(first, moves, s.master_x, x);
    put(first, moves, s.master_v, v);
    const V energy = dot(s.held, moved);
    s.master_energy += energy;
    if constexpr (kMethod == LaneMethod::nodes) return master_nodes();

    // Mailbox::collect.
    const Ring mail{*this, b.to_master, 1, words_to_master(N, kMethod)};
    const M fresh = arrives(1);
    const bool all_fresh = bits(fresh) == (1U << kLanes) - 1;
    s.received[1] += one_if(fresh);
    set(fresh, s.f_rx, mail.vector(0));
    if (b.measured) set(fresh, s.f_coupling_rx, mail.vector(2 * N + 1));
    if constexpr (kPart == Part::run) set(fresh, s.delayed_force, mail.vector(N));
    set(fresh, s.slave_energy, most(s.slave_energy, mail[2 * N]));
    if (any(s.slave_known == 0.0)) set(fresh & (s.slave_known == 0.0), s.first_at[1], s.k);
    set(fresh, s.slave_known, all(1.0));
    set(fresh, s.slave_heard_at, s.k);
    set(fresh, s.force_lag, p.lag[1] + 1.0);
    if constexpr (kModel) {
      constexpr int kFrom = 3 * N + 1;
      InternalModel<V, N>& m = s.model;
      set(fresh, m.contact_rx, mail[kFrom]), set(fresh, m.found_rx.stiffness, mail[kFrom + 1]);
      set(fresh, m.found_rx.friction, mail[kFrom + 2]), set(fresh, m.found_rx.curvature, mail[kFrom + 3]);
      set(fresh, m.found_rx.normal, mail.vector(kFrom + 4)), set(fresh, m.found_rx.point, mail.vector(kFrom + 4 + N));
      set(fresh, m.echo_rx, mail.vector(kFrom + 4 + 2 * N)), set(fresh, m.robot_rx, mail.vector(kFrom + 4 + 3 * N));
      set(fresh, m.heard, mail[kFrom + 4 + 4 * N]);
    }

    // MasterNode::step.
    book(s.master_absorbed, s.master_returned, energy);
    if (!all_fresh || any(s.master_mode != 1.0)) {
      const M begins = new_mode(s.master_mode, s.slave_known != 0.0, s.slave_heard_at, 1);
      set(begins, s.ramp, V{});
      if constexpr (kModel)
        if (any(begins)) [[unlikely]] {
          InternalModel<V, N>& m = s.model;
          set(begins, m.exists, V{}), set(begins, m.model_ramp, V{}), set(begins, m.offset_m, V{});
          set(begins, m.sticks, V{}), set(begins, m.sticks_at_echo, V{});
          set(begins, m.r, Vector{}), set(begins, m.r_along, Vector{});
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

    Vector f;
    master_dissipated = undissipated = V{};
    if constexpr (kModel) {
      predict(moved, moves, first);
      step_internal_model(p, s, moved, f, wanted, master_dissipated, undissipated);
    } else {
      f = wanted = select(active, s.ramp * (p.force_scale * s.f_rx), Vector{});
    }
    if constexpr (!kTdpa) {
      master_energy_in = s.master_absorbed;
    } else {
      // TdpaMaster::step.
      if (b.measured) book(s.command_absorbed, s.command_returned, dot(s.command_force, moved));
      if constexpr (kMethod == LaneMethod::predictive) predict(moved, moves, first);
      if (b.measured) s.command_force = p.force_scale * s.f_coupling_rx;
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
    if (any(beyond)) set(beyond, f, (p.most_force / size) * f);
    s.held = f;
    V* const to = to_send(b.to_slave, words_to_slave(N, kMethod));
    write(to, s.master_x);
    write(to + N, s.master_v);
    to[2 * N] = master_energy_in;
    if constexpr (kModel) {
      const InternalModel<V, N>& m = s.model;
      write(to + 2 * N + 1, m.offset_m * m.offset_normal);
      write(to + 3 * N + 1, m.felt);
      to[4 * N + 1] = m.heard;
    }
  }
  /// PortVelocityPredictor::step.
  void predict(const Vector& moved, M moves, bool first) {
    const V c = p.response;
    const Vector expected = s.predicted_u + s.predicted_d - c * (s.predicted_applied + s.held);
    Vector error = moved / p.dt - expected;
    if (first) set(~moves, error, Vector{});
    const Vector left = error - all(0.25) * s.predicted_before;
    s.predicted_before = error;
    s.predicted_u = expected + all(0.75) * error;
    s.predicted_d += all(0.25) * error;
    s.predicted_applied = s.held;
    s.predicted_w = s.predicted_u + s.predicted_d - c * s.held;
    s.predicted_error = most(root(norm2(error)), 0.95 * s.predicted_error);
    s.predicted_worst = most(s.predicted_error, root(norm2(left)) + p.worst_of_hand);
  }
  /// predictive_impedance_controller.
  void control_predicted(Vector& f, V available, M active) {
    const V deficit = select(available < 0.0, -available, V{});
    const V f2 = norm2(f);
    const V predicted = dot(f, s.predicted_w), power = predicted - root(f2) * s.predicted_error;
    const V q = dot(f, p.response * f);
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
    set(acts, undissipated, deficit - clamp(taken, V{}, deficit));
    master_dissipated = select(acts, select(more > 0.0, more, V{}), V{});
    set(acts, f, scale * f);
  }
  /// passivity_controller of a force: CLASSIC or FORCE_PROJECTED.
  void control_one_port(Vector& f, V available, M active) {
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
      set(acts, f, f + gain * s.master_v);
      master_dissipated = select(acts, fresh + repaid, V{});
      set(acts, undissipated, deficit - repaid);
      return;
    }
    const V out2 = norm2(f);
    const M across = (out2 < 1e-24) | (power * power < 1e-20 * in2 * out2);
    set(acts & across, undissipated, due);
    acts &= ~across;
    const V repaid = least(deficit, p.most_gain * dt * power * power / out2);
    V scale = 1.0 + (fresh + repaid) / (dt * power);
    if (b.unilateral) scale = select(scale < 0.0, V{}, scale);
    const V taken = (scale - 1.0) * power * dt, left = due - taken;
    master_dissipated = select(acts, taken, V{});
    set(acts, undissipated, select(left > 0.0, left, V{}));
    set(acts, f, scale * f);
  }
  /// DelayedForce: while nothing is heard the environment's force goes on, as old as it was.
  void remember_force(unsigned lanes) {
    constexpr int kWords = words_to_master(N, kMethod);
    for (int lane = 0; lane < kLanes; ++lane) {
      if ((lanes >> lane & 1U) == 0) continue;
      const double lag = s.force_lag[lane];
      const std::int64_t slot = (b.clock - ((std::int64_t)lag - 1)) & (b.slots - 1);
      for (int i = 0; i < N; ++i)
        s.delayed_force[i][lane] = s.k[lane] + 1.0 >= lag ? b.to_master[(slot * kWords + N + i) * kLanes + lane] : 0.0;
    }
  }

  V squared_angle(unsigned lanes, const Vector& u, const Vector& f, V u2, V f2) {
    V out{};
    for (int lane = 0; lane < kLanes; ++lane) {
      if ((lanes >> lane & 1U) == 0) continue;
      double u1[N], f1[N];
      for (int i = 0; i < N; ++i) u1[i] = u[i][lane], f1[i] = f[i][lane];
      out[lane] = b.squared_angle(u1, f1, u2[lane], f2[lane]);
    }
    return out;
  }
  V angle2(M of, const Vector& u, const Vector& f, V u2, V f2) {
    const V along = dot(u, f);
    if constexpr (N == 1) {
      return select(of & (along < 0.0), all(3.14159265358979323846 * 3.14159265358979323846), V{});
    } else {
      const V share = along / f2, across2 = u2 - along * share;
      const M small = (along > 0.0) & (across2 < 1e-14 * u2);
      V out = select(small, norm2(u - share * f) / u2, V{});
      const M large = of & ~small;
      if (any(large)) set(large, out, squared_angle(bits(large), u, f, u2, f2));
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
      set(~following, t.last_apart_row, s.k + 1.0);
    }

    const V correction2 = norm2(s.held - wanted), felt2 = norm2(s.held), wanted2 = norm2(wanted);
    t.force_error2 += correction2;
    raise(t.correction2, correction2);
    raise(t.force2, felt2);
    const Vector fast = p.filter_b0 * s.held + t.filter_1;
    t.filter_1 = (-2.0 * p.filter_b0) * s.held - p.filter_a1 * fast + t.filter_2;
    t.filter_2 = p.filter_b0 * s.held - p.filter_a2 * fast;
    t.chatter2 += norm2(fast);
    constexpr double kFelt2 = 0.05 * 0.05;
    const M is_wanted = wanted2 > kFelt2, compared = is_wanted & (felt2 > kFelt2);
    count(t.wanted_rows, is_wanted);
    count(t.turned_rows, compared);
    const M turns = compared & (correction2 != 0.0);
    if (any(turns)) {
      const V turn2 = angle2(turns, s.held, wanted, felt2, wanted2);
      set(turns & (turn2 > t.turn2_max), t.turn2_max, turn2);
      t.turn2 += select(turns, turn2, V{});
    }

    // Contact.
    count(t.uncoupled, ~coupled);
    const Vector reference = p.force_scale * -s.delayed_force;
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
      set(~held, t.held_ticks, V{});
    }
    if (any(touching)) {
      count(t.touching, touching);
      const V size = N == 1 ? absolute(env[0]) : root(env2);
      t.environment_force += select(touching, size, V{});
      t.error2 += select(touching, norm2(s.held - reference), V{});
      const M both = touching & (felt2 > kFelt2) & (reference2 > kFelt2);
      if (any(both)) {
        count(t.compared, both);
        t.contact_turn2 += select(both, angle2(both, s.held, reference, felt2, reference2), V{});
      }
      constexpr double kLoud2 = 0.2 * 0.2, kMuted2 = 0.1 * 0.1;
      const M quiet = touching & (reference2 <= kLoud2);
      count(t.quiet, quiet);
      count(t.muted, touching & ~quiet & (felt2 < kMuted2 * reference2));
      const Vector ahead = select(following, p.motion_scale * s.master_x + s.hand_origin - s.slave_x, Vector{});
      const V behind = -dot(env, ahead);
      const M deeper = touching & (behind > 0.0) & (behind * behind > t.penetration2 * env2);
      set(deeper, t.penetration2, behind * behind / env2);
      if (any(held)) {
        V* const row = (V*)(b.window + (b.clock & (b.window_slots - 1)) * 2 * N * kLanes);
        write(row, s.held);
        write(row + N, reference);
        const V next = t.held_next + 1.0;
        set(held, t.held_next, select(next == p.window, V{}, next));
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
    set(s.master_mode == 1.0, t.was_coupled, all(1.0));
    t.apart_at_end = select(coupled, V{}, t.apart_at_end + 1.0);

    // Contacts::add.
    const M pressed = env2 != 0.0;
    if (b.keeps_states && any(pressed)) {
      t.pressed += select(pressed, root(env2), V{});
      const M seen = pressed & (p.late != 0.0);
      if (b.wall && any(seen)) {
        const M looks = seen & (t.late_ticks == 0.0);
        const V next = t.late_ticks + 1.0;
        set(seen, t.late_ticks, select(next == 8.0, V{}, next));
        if (any(looks)) set(looks & (dot(p.normal, s.slave_x) - p.offset < 0.0), t.touched, all(1.0));
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
    write(row, s.master_v);
    write(row + N, s.slave_v);
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
};

// Every call in it inlined: FORCE_PROJECTED is then 7 % faster.
template <int N, Part kPart, LaneMethod kMethod>
TWOPORT_FLATTEN static std::int64_t run_ticks(Batch& b, std::int64_t ticks) {
  Loop<N, kPart, kMethod> loop{b};
  b.diverged = 0;
  for (std::int64_t i = 0; i < ticks; ++i) {
    const bool first = kPart == Part::run && i == 0 && any(loop.s.k == 0.0);
    const unsigned diverged = first ? loop.tick(true) : loop.tick(false);
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
