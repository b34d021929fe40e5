; One step of admittance_controller (common/passivity/controller.h): force and motion of the virtual coupling at once.
;
;   f = s f_d,  v = v_d - (1 - s) G⁻¹ f_d,  P = f_d·v_d,  Q = f_dᵀG⁻¹f_d > 0
;   s = (√((P - Q)² + 4 Q a) - (P - Q))/(2 Q) within [0, 1], where P > a = max(A, 0)/T
;
; Claim: the outflow is bounded exactly, f·v <= a, and s is within [0, 1].
; turned: s/(- root (- P Q))/(+ root (- P Q))/
; turned: s/(- P (\* (- 1 s) Q))/(+ P (* (- 1 s) Q))/
(set-logic QF_NRA)
(declare-const P Real) (declare-const Q Real) (declare-const a Real) (declare-const root Real) (declare-const s Real)
(assert (and (> Q 0) (>= a 0) (> P a) (>= root 0)))
(assert (= (* root root) (+ (* (- P Q) (- P Q)) (* 4 Q a))))
(assert (= (* 2 Q s) (- root (- P Q))))
(define-fun outflow () Real (* s (- P (* (- 1 s) Q))))
(assert (not (and (<= outflow a) (<= 0 s) (<= s 1))))
(check-sat)
