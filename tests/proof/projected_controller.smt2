; One step of passivity_controller, FORCE_PROJECTED (common/passivity/controller.h), without reference energy.
;
;   P = f·v [W],  A = available energy [J],  s = max(0, 1 + (D + R)/(T P)),  D = max(0, -max(A, 0) - P T),  0 <= R <= max(-A, 0)
;
; Claim: where the predicted f·v is the true one, the account does not fall below zero: A + T s P >= 0 for A >= 0, and
; nothing flows out for A < 0.
; turned: s/(- 0 (pos A) (\* P T))/(+ (pos A) (* P T))/
; turned: s|(+ 1 (/ (+ D R)|(- 1 (/ (+ D R)|
(set-logic QF_NRA)
(define-fun pos ((x Real)) Real (ite (> x 0) x 0))
(declare-const T Real) (declare-const P Real) (declare-const A Real) (declare-const R Real)
(assert (and (> T 0) (not (= P 0)) (<= 0 R) (<= R (pos (- A)))))
(define-fun D () Real (pos (- 0 (pos A) (* P T))))
(define-fun s () Real (pos (+ 1 (/ (+ D R) (* T P)))))
(define-fun inflow () Real (* T s P))
(assert (not (and (=> (>= A 0) (>= (+ A inflow) 0)) (=> (< A 0) (>= inflow 0)))))
(check-sat)
