; Error of the predicted velocity of a handle (PortVelocityPredictor, common/passivity/velocity_predictor.h), one axis.
;
;   a mass under held forces: v(k) = v(k-1) + C (F(k-1) + F(k) - f(k-1) - f(k)),   F: the hand's own force, f: the port's
;   predictor: x(k) = u(k-1) + d(k-1) - C (f(k-1) + f(k)),  e(k) = v(k) - x(k),  u(k) = x(k) + 3/4 e(k),  d(k) = d(k-1) + e(k)/4
;
; Claim: |e(2)| <= |e(1) - e(0)/4| + C F_h where |F(2) - F(0)| <= F_h.
; turned: s/(\* (\/ 1 4) e0))))/(* (\/ 1 2) e0))))/
; turned: s/(<= (abs1 (- F2 F0)) Fh)/(<= (abs1 (- F2 F1)) Fh)/
(set-logic QF_NRA)
(declare-const C Real) (declare-const Fh Real)
(declare-const F0 Real) (declare-const F1 Real) (declare-const F2 Real)
(declare-const f0 Real) (declare-const f1 Real) (declare-const f2 Real)
(declare-const v0 Real) (declare-const x0 Real) (declare-const d0 Real)
(define-fun abs1 ((a Real)) Real (ite (>= a 0) a (- a)))
(define-fun v1 () Real (+ v0 (* C (- (+ F0 F1) f0 f1))))
(define-fun v2 () Real (+ v1 (* C (- (+ F1 F2) f1 f2))))
(define-fun e0 () Real (- v0 x0))
(define-fun d1 () Real (+ d0 (* (/ 1 4) e0)))
(define-fun x1 () Real (- (+ x0 (* (/ 3 4) e0) d1) (* C (+ f0 f1))))
(define-fun e1 () Real (- v1 x1))
(define-fun d2 () Real (+ d1 (* (/ 1 4) e1)))
(define-fun x2 () Real (- (+ x1 (* (/ 3 4) e1) d2) (* C (+ f1 f2))))
(define-fun e2 () Real (- v2 x2))
(assert (and (> C 0) (<= (abs1 (- F2 F0)) Fh)))
(assert (not (<= (abs1 e2) (+ (* C Fh) (abs1 (- e1 (* (/ 1 4) e0)))))))
(check-sat)
