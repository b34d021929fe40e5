; One step of a damper's own account (DamperAccount, common/passivity/energy_spring.h).
;
;   L <= D0 level [J], work = λ g·Δx >= -G d with |γ g| <= G, |Δx| <= d, and no force where L <= 0; refill = r T >= 0
;
; Claim: where -G d <= L, the next level L' = min(D0, L + work + refill) is within [-G d, D0] too, and what the damper has given is at
; most what the level has lost: work >= L' - L - refill.
; turned: s/(- (\* G d))/(- (* 2 G d))/
; turned: s/(= work 0)/(= work (- 1))/
; turned: s/(>= work (- (- next L) refill))/(>= work (+ (- next L) refill))/
(set-logic QF_NRA)
(declare-const L Real) (declare-const D0 Real) (declare-const G Real) (declare-const d Real)
(declare-const work Real) (declare-const refill Real)
(assert (and (> D0 0) (>= G 0) (>= d 0) (>= refill 0) (<= L D0) (>= L (* (- 1) G d))))
(assert (>= work (- (* G d))))
(assert (=> (<= L 0) (= work 0)))
(define-fun sum () Real (+ L work refill))
(define-fun next () Real (ite (< sum D0) sum D0))
(assert (not (and (>= next (* (- 1) G d)) (<= next D0) (>= work (- (- next L) refill)))))
(check-sat)
