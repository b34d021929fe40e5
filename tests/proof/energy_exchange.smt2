; Energy exchange (common/method/passivity/energy_exchange/account.h): one tick of both sides.
;
;   side     V = E0 + W - S, level A = V + R >= 0; R: what has been heard of the other side's S
;   port     gives p <= A, p < 0: takes
;   share    0 <= x, p + x <= A:   V' = V - p - x,  S' = S + x
;   way      what has been heard is at most what was sent: Rm <= Ss, Rs <= Sm
;   both     Wm + Ws = (Vm + Sm - E0m) + (Vs + Ss - E0s)
;
; Claim: Wm' + Ws' >= -E0m - E0s, and A >= 0 again on both sides, as R never falls.
; turned: s/(<= Rm Ss)/(<= Rm (+ Ss 1))/
; turned: s/(<= (+ pm xm) (+ Vm Rm))/(<= pm (+ Vm Rm))/
; turned: s/(<= (+ ps xs) (+ Vs Rs))/(<= xs (+ Vs Rs))/
(set-logic QF_LRA)
(declare-const Vm Real) (declare-const Vs Real) (declare-const Sm Real) (declare-const Ss Real)
(declare-const Rm Real) (declare-const Rs Real) (declare-const E0m Real) (declare-const E0s Real)
(declare-const pm Real) (declare-const ps Real) (declare-const xm Real) (declare-const xs Real)
(assert (and (>= E0m 0) (>= E0s 0) (>= (+ Vm Rm) 0) (>= (+ Vs Rs) 0) (<= Rm Ss) (<= Rs Sm) (>= xm 0) (>= xs 0)))
(assert (<= (+ pm xm) (+ Vm Rm)))
(assert (<= (+ ps xs) (+ Vs Rs)))
(define-fun Vm2 () Real (- Vm pm xm))
(define-fun Vs2 () Real (- Vs ps xs))
(define-fun Sm2 () Real (+ Sm xm))
(define-fun Ss2 () Real (+ Ss xs))
(define-fun both () Real (+ (- (+ Vm2 Sm2) E0m) (- (+ Vs2 Ss2) E0s)))
(assert (not (and (>= both (- (+ E0m E0s))) (>= (+ Vm2 Rm) 0) (>= (+ Vs2 Rs) 0))))
(check-sat)
