@testset "$(x.name)" for x in H.INSTANCES
    m = x.make()
    @test x.version >= 1 && length(x.history) == x.version
    @test all(isfile, joinpath.(pkgdir(PomdpHarness), "src", x.sources))
    @test length(H.source_hash(x.sources)) == 64
    @test instance(x.name) === x
end
@test_throws ArgumentError instance("rocksample-7x7")

@testset "layouts" begin
    m = instance("rocksample-7x8").make()
    @test m.rocks == [(3, 1), (1, 2), (4, 2), (7, 4), (3, 5), (4, 5), (6, 6), (2, 7)]
    @test m.start == (1, 4)
    @test length(states(instance("rocksample-11x11").make())) == 247_809
end
