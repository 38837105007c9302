//! Time of a plan and of its parts, for three model sizes and 100 candidates.
#![allow(missing_docs, clippy::unwrap_used, reason = "a bench")]

#[path = "../tests/fixture/mod.rs"]
mod fixture;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use grip_planner::{
    Action, Coverage, CoverageOptions, Options, PlanOptions, TurnOptions, agent_box, candidates,
    plan, plan_grips, turn_over,
};

fn bench(c: &mut Criterion) {
    let arms = fixture::arms(3);
    let scene = fixture::scene(&arms);
    let mut group = c.benchmark_group("plan");
    for count in [500, 1000, 2000] {
        // The fixture keeps the upper half of the samples.
        let body = fixture::usual(2 * count);
        let model = body.model();
        let options = PlanOptions::default();
        group.throughput(Throughput::Elements(model.points.len() as u64));
        group.bench_function(BenchmarkId::new("whole", count), |b| {
            b.iter(|| plan(&model, &scene, Action::TurnOver, &options).unwrap());
        });
        let found = candidates(&model, &scene, &Options::default()).unwrap();
        let vertices: Vec<u32> = found.accepted.iter().map(|c| c.vertex).collect();
        group.bench_function(BenchmarkId::new("candidates", count), |b| {
            b.iter(|| candidates(&model, &scene, &Options::default()));
        });
        group.bench_function(BenchmarkId::new("coverage", count), |b| {
            b.iter(|| Coverage::new(&model, &scene.table, &vertices, &CoverageOptions::default()));
        });
        let coverage =
            Coverage::new(&model, &scene.table, &vertices, &CoverageOptions::default()).unwrap();
        group.bench_function(BenchmarkId::new("all pairs", count), |b| {
            b.iter(|| coverage.pairs().map(|p| p.1).sum::<f64>());
        });
        group.bench_function(BenchmarkId::new("best triple", count), |b| {
            b.iter(|| coverage.best_triple());
        });
        group.bench_function(BenchmarkId::new("agent box", count), |b| {
            b.iter(|| agent_box(model.points, &scene.table));
        });
        let sets = plan_grips(&model, &scene, &Options::default())
            .unwrap()
            .sets;
        group.bench_function(BenchmarkId::new("turn over", count), |b| {
            b.iter(|| turn_over(&model, &scene, &sets[0], &TurnOptions::default()));
        });
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
