; One step of the energy spring (common/passivity/energy_spring.h): a force of at most √(2 K A) against the motion.
;
;   A >= 0 energy available [J], K > 0 stiffness of the bound, root = √A, scaled force |f| <= √(2 K) root, |Δx| <= d
;
; Claim: what flows out in the interval leaves A + f·Δx >= -K d²/2, however the port moves: the bound of one tick, which
; does not accumulate, as the force is zero while A < 0.
; turned: s/(+ A work)/(+ (- A) work)/
; turned: s/(- (\* F d))/(- (* 2 F d))/
(set-logic QF_NRA)
(declare-const A Real) (declare-const K Real) (declare-const k Real) (declare-const root Real)
(declare-const F Real) (declare-const d Real) (declare-const work Real)
(assert (and (>= A 0) (> K 0) (>= root 0) (= (* root root) A) (>= k 0) (= (* k k) (* 2 K)) (>= d 0)))
(assert (and (<= 0 F) (<= F (* k root))))
(assert (>= work (- (* F d))))
(assert (not (>= (+ A work) (- (/ (* K d d) 2)))))
(check-sat)
