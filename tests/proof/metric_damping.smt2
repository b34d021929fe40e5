; metric_damping (common/passivity/controller.h): C = (g/T) M V takes the energy D from a mass with W = VᵀMV.
;
;   g = 1 - √(1 - 2D/W),  0 <= 2D <= W;   T C·(V - T M⁻¹C/2) = (g - g²/2) W
;
; Claim: that is D, and g is within [0, 1].
; turned: s/(- 1 root)/(+ 1 root)/
; turned: s/(- W (\* 2 D))/(+ W (* 2 D))/
(set-logic QF_NRA)
(declare-const D Real) (declare-const W Real) (declare-const root Real)
(assert (and (> W 0) (<= 0 D) (<= (* 2 D) W) (>= root 0)))
(assert (= (* root root W) (- W (* 2 D))))
(define-fun g () Real (- 1 root))
(assert (not (and (= (* (- g (/ (* g g) 2)) W) D) (<= 0 g) (<= g 1))))
(check-sat)
