; One step of predictive_impedance_controller (common/passivity/controller.h).
;
;   w_true·f >= p           the mean velocity without a force is known within the error bound
;   s in [0, 1],  q s² - p s <= a,  q = fᵀC f >= 0,  a = max(A, 0)/T - R/T,  0 <= R
;
; The port moves by T (w_true - s C f) while s f is held. Claim: what flows in over the interval is at least -max(A, 0) + R.
; turned: s/(- (\* q s s) (\* p s))/(+ (* q s s) (* p s))/
; turned: s/(- w (\* s q))/(- (- w) (* s q))/
(set-logic QF_NRA)
(define-fun pos ((x Real)) Real (ite (> x 0) x 0))
(declare-const T Real) (declare-const p Real) (declare-const q Real) (declare-const w Real)
(declare-const A Real) (declare-const R Real) (declare-const s Real)
(assert (and (> T 0) (>= q 0) (>= w p) (>= R 0) (<= 0 s) (<= s 1)))
(assert (<= (- (* q s s) (* p s)) (/ (- (pos A) R) T)))
(define-fun inflow () Real (* T s (- w (* s q))))
(assert (not (>= inflow (- R (pos A)))))
(check-sat)
