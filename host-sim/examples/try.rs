//! try
use host_sim::{evaluate::*, model};
fn main() {
    let b = model::reduce::reduce(&model::shipped("girder50").unwrap()).unwrap().cast::<f32>();
    let a: Vec<String> = std::env::args().collect();
    let m = match a[1].as_str() { "p" => Method::PaperGa, "m" => Method::MicroGa, _ => Method::Hybrid };
    let seeds: u64 = a[2].parse().unwrap();
    for c in &CASES_2DOF {
        if a.len() > 3 && !a[3].split(',').any(|x| x == c.number.to_string()) { continue; }
        for s in 0..seeds {
            let f = run(&b, c, m, s).unwrap();
            println!("case {} seed {s} {} {:?} obj {:.2e} gen {} solves {} {:.2}s", c.number, if f.code == c.code() {"OK  "} else {"FAIL"}, f.code.genes(), f.objective, f.generations, f.forward_solves, f.seconds);
        }
    }
}
