; Strict two-port passivity of internal-model control (common/method/passivity/energy_spring): one tick at both halves.
;
;   master   work of its force p >= -A, A = E + E0/2 (energy_spring_with_prediction.smt2);   E' = E + p
;   slave    L >= 0, work that leaves q <= L (admittance_controller.smt2);                  L' = L - q
;   way      what is under way, sent less received, is V >= 0
;   both     W - O = E + V + L - E0/2 before, W' - O' = W - O + p - q after
;
; Claim: W' - O' >= -E0, and E' >= -E0/2, L' >= 0 again.
; turned: s/(>= p (- A))/(>= p (* (- 2) (+ A 1)))/
; turned: s/(<= q L)/(<= q (* 2 (+ L 1)))/
; turned: s/(>= V 0)/(>= V (- 1))/
(set-logic QF_NRA)
(declare-const E Real) (declare-const E0 Real) (declare-const L Real) (declare-const V Real) (declare-const q Real)
(declare-const p Real)
(define-fun A () Real (+ E (/ E0 2)))
(assert (and (>= E0 0) (>= A 0) (>= L 0) (>= V 0) (<= q L)))
(assert (>= p (- A)))
(define-fun both () Real (+ (- (+ E V L) (/ E0 2)) (- p q)))
(assert (not (and (>= both (- E0)) (>= (+ E p) (- (/ E0 2))) (>= (- L q) 0))))
(check-sat)
