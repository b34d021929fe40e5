; The energy spring in a tick that moves the port by no more than its reach d (EnergySpring, common/passivity/energy_spring.h), and the
; damper's account there.
;
;   |h| <= A/d, |Δx| <= d, λ in [0, 1]:  λ h·Δx = p >= -|h| |Δx|;     |g| d <= D1:  λ g·Δx = w >= -|g| |Δx|, and w = 0 where L <= 0
;
; Claim: A + p >= 0, and L + w >= -D1 where L >= -D1.
; turned: s/(<= (\* h d) A)/(<= (* h d) (* 2 A))/
; turned: s/(<= x d)/(<= x (* 2 d))/
; turned: s/(=> (<= L 0) (= w 0))/true/
(set-logic QF_NRA)
(declare-const A Real) (declare-const h Real) (declare-const d Real) (declare-const x Real) (declare-const p Real)
(declare-const g Real) (declare-const w Real) (declare-const L Real) (declare-const D1 Real)
(assert (and (>= A 0) (>= h 0) (> d 0) (>= x 0) (<= x d)))
(assert (<= (* h d) A))
(assert (>= p (- (* h x))))
(assert (and (>= g 0) (> D1 0) (<= (* g d) D1) (>= w (- (* g x))) (>= L (- D1))))
(assert (=> (<= L 0) (= w 0)))
(assert (not (and (>= (+ A p) 0) (>= (+ L w) (- D1)))))
(check-sat)
