//! Whole agents, through the training loop, must learn a task that the PyTorch reference learns.

use crate::support::learning::follow_the_dot;

/// The reference goes from 31–35 of 50, untrained, to 45–47 within 1,500 agent steps, 500 of them random.
#[test]
fn hksl_learns_to_follow_the_dot() {
    assert_learns("hksl", &[]);
}

/// As many as hksl needs; the example `follow_the_dot` does the same with every method.
#[test]
fn drq_learns_to_follow_the_dot() {
    assert_learns("drq", &["augmentation.pad=1".to_owned()]);
}

fn assert_learns(method: &str, more: &[String]) {
    let returns = follow_the_dot(method, 1, 1500, more);
    println!("{method}: returns at every 250 agent steps: {returns:.1?}");
    let [untrained, .., a, b, c] = returns[..] else { panic!("too few evaluations: {returns:?}") };
    // The best of three, since a policy that moves every step can be caught in a bad moment.
    let trained = a.max(b).max(c);
    assert!(untrained < 39.0, "the untrained agent is too good: {returns:?}");
    assert!(trained > 41.0, "it has not learnt: {returns:?}");
}
