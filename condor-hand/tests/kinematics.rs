//! Kinematics against the results of other programs, and against itself.

mod support;

#[test]
fn a_finger_and_its_chain_have_one_base() {
    let geometry = support::geometry();
    for finger in 0..support::FINGERS {
        let chain = geometry.chain::<f64>(finger);
        assert_eq!(chain.base, geometry.finger(finger).base);
    }
}
