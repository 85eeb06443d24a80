//! Where the time of an identification goes: a loop for a profiler.

use host_sim::{
    evaluate::{Case, Signal},
    identification::Observed,
    model,
};
use spanwatch::capacity::UNKNOWNS;
use spanwatch::identify::{Pass, pass::Shifts, unknowns::Theta};
use spanwatch::wire::message::TrainKind;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let kind = if a[1] == "i" {
        TrainKind::Inspection2Dof
    } else {
        TrainKind::Shinkansen3d
    };
    let case = Case::numbered(a[2].parse().unwrap(), kind).unwrap();
    let obs = Observed::simulated(&model::shipped("girder50").unwrap(), &case.scenario(Signal::Recorded)).unwrap();
    let p = obs.problem();
    let mut pass = Box::new(Pass::new());
    let theta = Theta::zeros();
    let free: [bool; UNKNOWNS] = core::array::from_fn(|i| i < a[4].parse().unwrap());
    for _ in 0..a[5].parse().unwrap() {
        let t = std::time::Instant::now();
        if a[3] == "c" {
            pass.compare(&p, &theta, [1.0; 3], Shifts::NONE).unwrap();
        } else {
            pass.linearise(&p, &theta, [1.0; 3], &free).unwrap();
        }
        while !pass.advance(&p) {}
        println!("{} rows {:?}", p.recorded().len(), t.elapsed());
    }
}
