; The energy spring beside a damping force g in a tick in which the prediction of the handle holds (EnergySpring, common/passivity/energy_spring.h).
;
;   w_true·f >= p,  q = fᵀC f >= 0,  c = gᵀC f,  s in [0, 1],  q s² - (p - 2 c) s <= (A - R)/T,  0 <= R <= A
;   G = g·w - gᵀC g >= -R/T: power that g alone takes in
;
; The port moves by T (w - C F) while F = λ (s f + g) is held, λ in [0, 1]: what the device applies of it. Claim: A + work of F >= 0.
; turned: s/(\* 2 c)/(* (- 2) c)/
; turned: s/(\/ (- A R) T)/(\/ A T)/
; turned: s/(<= lambda 1)/(<= lambda 2)/
(set-logic QF_NRA)
(declare-const T Real) (declare-const p Real) (declare-const q Real) (declare-const c Real) (declare-const w Real)
(declare-const gw Real) (declare-const gg Real) (declare-const A Real) (declare-const R Real) (declare-const s Real)
(declare-const lambda Real)
(assert (and (> T 0) (>= q 0) (>= w p) (<= 0 R) (<= R A) (<= 0 s) (<= s 1)))
(assert (<= (- (* q s s) (* s (- p (* 2 c)))) (/ (- A R) T)))
(assert (>= (- gw gg) (- (/ R T))))
; F·w and FᵀC F with λ = 1; C is positive semidefinite
(define-fun in () Real (+ (* s w) gw))
(define-fun own () Real (+ (* q s s) (* 2 s c) gg))
(assert (>= own 0))
(assert (and (<= 0 lambda) (<= lambda 1)))
(assert (not (>= (+ A (* T (- (* lambda in) (* lambda lambda own)))) 0)))
(check-sat)
