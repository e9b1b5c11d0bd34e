//! The noise of simulated sensors.

use condor_hand::plant::Noise;

#[test]
fn noise_is_centred_and_of_unit_deviation() {
    let mut noise = Noise::new(977);
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..20_000 {
        let x = noise.normal();
        sum += x;
        squares += x * x;
    }
    assert!((sum / 20_000.0_f64).abs() < 0.03);
    assert!((squares / 20_000.0_f64 - 1.0).abs() < 0.05);
}
