use farsight_train::{
    config::RunConfig,
    metrics::Record,
    trainer::{Job, Observer, train},
};
struct O;
impl Observer for O {
    fn begin(&mut self, d: u64, t: u64) {
        eprintln!("{d}/{t}");
    }
    fn step(&mut self, r: &Record) {
        if r.step <= 5 || r.step % 20 == 0 {
            eprintln!(
                "{} loss {:.3} hm {:.3} o {:.3} d {:.3} l {:.3} gn {:.2} {:.2}/s",
                r.step,
                r.loss,
                r.terms.heat_map,
                r.terms.orientation,
                r.terms.dimensions,
                r.terms.location,
                r.gradient_norm,
                r.samples_per_second
            );
        }
    }
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let mut run = RunConfig::read(a[1].as_ref()).unwrap();
    run.data.root = Some(a[2].clone().into());
    println!("{:?}", train(&Job { run, out: a[3].clone().into(), resume: a.len() > 4 }, &mut O));
}
