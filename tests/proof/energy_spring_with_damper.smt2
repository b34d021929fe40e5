; The energy spring and the damper's account together, one step (docs/reference/energy-bound.md, step 3).
;
;   S = K d²/2 >= 0, time t, refill r T = refill;  B(k) = E(k) + E(0) - L(k)
;   spring     E + E(0) > 0: A + λ h·Δx >= -S  (energy_spring.smt2);   E + E(0) <= 0: h = 0
;   damper     work >= L' - L - refill          (damper_account.smt2),   L <= D0
;   invariant  B(k) >= -S - D0 - spent,          spent = r t
;
; Claim: the invariant holds after the step, with spent' = spent + refill.
; turned: s/(>= (+ A spring) (- S))/(>= (- A spring) (- S))/
; turned: s/(+ E spring work)/(+ E spring (- work))/
; turned: s/(=> (<= A 0) (= spring 0))/(=> (<= A 0) (= spring -1))/
(set-logic QF_LRA)
(declare-const A Real) (declare-const S Real) (declare-const E Real) (declare-const E0 Real)
(declare-const L Real) (declare-const next Real) (declare-const D0 Real) (declare-const spent Real) (declare-const refill Real)
(declare-const spring Real) (declare-const work Real)
(assert (and (>= S 0) (>= E0 0) (>= D0 0) (>= refill 0) (>= spent 0) (<= L D0)))
(assert (= A (+ E E0)))
(assert (=> (> A 0) (>= (+ A spring) (- S))))
(assert (=> (<= A 0) (= spring 0)))
(assert (>= work (- (- next L) refill)))
(assert (>= (- (+ E E0) L) (- (- (- S) D0) spent)))
(assert (not (>= (- (+ (+ E spring work) E0) next) (- (- (- S) D0) (+ spent refill)))))
(check-sat)
