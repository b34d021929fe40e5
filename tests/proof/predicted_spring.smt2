; The energy spring beside a damping force g, where the prediction of the handle holds (EnergySpring::feasible_part).
;
;   w_true·f >= p,  q = fᵀC f >= 0,  c = gᵀC f,  s in [0, 1],  q s² - (p - 2 c) s <= A/T
;   G = g·w - gᵀC g: power that g alone would take in
;
; The port moves by T (w - C (s f + g)) while s f + g is held. Claim: what flows in is at least -A + T G.
; turned: s/(\* 2 c)/(* (- 2) c)/
; turned: s/(- (\* q s s)/(+ (* q s s)/
(set-logic QF_NRA)
(declare-const T Real) (declare-const p Real) (declare-const q Real) (declare-const c Real) (declare-const w Real)
(declare-const G Real) (declare-const A Real) (declare-const s Real)
(assert (and (> T 0) (>= q 0) (>= w p) (>= A 0) (<= 0 s) (<= s 1)))
(assert (<= (- (* q s s) (* s (- p (* 2 c)))) (/ A T)))
; (s f + g)·(w - C (s f + g)) = s f·w - s² q - 2 s c + G
(define-fun inflow () Real (* T (+ (- (* s w) (* s s q) (+ (* s c) (* s c))) G)))
(assert (not (>= inflow (+ (- A) (* T G)))))
(check-sat)
