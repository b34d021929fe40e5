; Strict two-port passivity of internal-model control (common/method/internal_model): one tick at both halves.
;
;   master   |g| d <= A, |h| d <= A - |g| d, |Δx| <= d, so w >= -|g| |Δx|, p >= -|h| |Δx|;  A = E + E0/2,  E' = E + p + w
;   slave    L >= 0, work that leaves q <= L (admittance_controller.smt2);                  L' = L - q
;   way      what is under way, sent less received, is V >= 0
;   both     W - O = E + V + L - E0/2 before, W' - O' = W - O + p + w - q after
;
; Claim: W' - O' >= -E0, and E' >= -E0/2, L' >= 0 again.
; turned: s/(<= (\* h d) (- A (\* g d)))/(<= (* h d) A)/
; turned: s/(<= q L)/(<= q (* 2 (+ L 1)))/
; turned: s/(>= V 0)/(>= V (- 1))/
(set-logic QF_NRA)
(declare-const E Real) (declare-const E0 Real) (declare-const L Real) (declare-const V Real) (declare-const q Real)
(declare-const g Real) (declare-const h Real) (declare-const d Real) (declare-const x Real)
(declare-const p Real) (declare-const w Real)
(define-fun A () Real (+ E (/ E0 2)))
(assert (and (>= E0 0) (>= A 0) (>= L 0) (>= V 0) (<= q L)))
(assert (and (> d 0) (>= x 0) (<= x d) (>= g 0) (>= h 0) (<= (* g d) A)))
(assert (<= (* h d) (- A (* g d))))
(assert (and (>= w (- (* g x))) (>= p (- (* h x)))))
(define-fun both () Real (+ (- (+ E V L) (/ E0 2)) (- (+ p w) q)))
(assert (not (and (>= both (- E0)) (>= (+ E p w) (- (/ E0 2))) (>= (- L q) 0))))
(check-sat)
